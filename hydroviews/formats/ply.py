"""Point clouds in PLY files, as nerfstudio captures have them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from hydroviews.errors import InputError
from hydroviews.scene.checks import check_colours, usable
from hydroviews.scene.scenes import Points

GREY = 128


def read_ply(path: Path) -> Points:
    """The usable points of a cloud, grey where it has no colours.

    Raises:
        InputError: missing, not a point cloud, or against the rules of `scene.checks`.
    """
    try:
        vertices = PlyData.read(path)["vertex"].data
        positions = _columns(vertices, "x", "y", "z").astype(np.float64)
        coloured = "red" in vertices.dtype.names
        colours = _columns(vertices, "red", "green", "blue") if coloured else np.full(positions.shape, GREY)
    except (FileNotFoundError, IsADirectoryError):
        raise InputError(f"{path}: no such file", fix="copy it back, or remove ply_file_path") from None
    except (PlyParseError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a point cloud", found=error, fix="copy it again") from error
    kept = usable(path, positions)
    return Points(positions[kept], check_colours(path, colours[kept]))


def _columns(vertices: NDArray[Any], *names: str) -> NDArray[Any]:
    """[N, 3] from three fields of the vertices."""
    return np.stack([vertices[name] for name in names], axis=1)
