"""Point clouds in PLY files, as nerfstudio captures have them."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file
from hydroviews.scene.checks import check_colours, usable
from hydroviews.scene.scenes import Points

logger = logging.getLogger(__name__)

GREY = 128
COLOURS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
HARMONICS = ("f_dc_0", "f_dc_1", "f_dc_2")  # of Gaussians: colours as spherical harmonics of degree 0
DEGREE_0 = 0.28209479177387814  # 1 / (2 sqrt(pi))


def read_ply(path: Path) -> Points:
    """The usable points of a cloud, grey where it has no colours; a warning says so.

    Raises:
        InputError: missing, not a point cloud, or against the rules of `scene.checks`.
    """
    try:
        vertices = PlyData.read(as_file(path))["vertex"].data
        found = _by_lower_case(vertices)
        positions = _columns(vertices, *(found[axis] for axis in "xyz")).astype(np.float64)
        colours = _colours(path, vertices)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file", fix="copy it back, or remove ply_file_path") from None
    except (PlyParseError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a point cloud", found=error, fix="copy it again") from error
    kept = usable(path, positions)
    return Points(positions[kept], check_colours(path, colours[kept]))


def _colours(path: Path, vertices: NDArray[Any]) -> NDArray[Any]:
    """Colours [N, 3] from 0 to 255 by one of the usual names; grey, with a warning, where there are none."""
    found = _by_lower_case(vertices)
    for names in COLOURS:
        if all(name in found for name in names):
            return _columns(vertices, *(found[name] for name in names))
    if all(name in found for name in HARMONICS):
        encoded = 0.5 + DEGREE_0 * _columns(vertices, *(found[name] for name in HARMONICS))
        return np.asarray((255 * np.clip(encoded, 0, 1)).round())
    logger.warning(
        "%s: no colours, so that its points are grey; found %s, expected red, green, blue",
        path, ", ".join(found.values()),
    )  # fmt: skip
    return np.full((len(vertices), 3), GREY)


def _by_lower_case(vertices: NDArray[Any]) -> dict[str, str]:
    """The names of the vertices' fields by the names in small letters."""
    return {name.lower(): name for name in vertices.dtype.names or ()}


def _columns(vertices: NDArray[Any], *names: str) -> NDArray[Any]:
    """[N, 3] from three fields of the vertices."""
    return np.stack([vertices[name] for name in names], axis=1)
