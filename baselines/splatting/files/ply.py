"""The .ply file that every 3DGS viewer reads, out and in."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement, PlyHeaderParseError, PlyParseError

from baselines.splatting.files.finite import require_finite
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.splats.sh_coefficients import degree_of
from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing

SPLATS = "splats.ply"  # its name in the folder of a training
MEANS, NORMALS = ("x", "y", "z"), ("nx", "ny", "nz")
DC = ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES = ("scale_0", "scale_1", "scale_2")
QUATERNION = ("rot_0", "rot_1", "rot_2", "rot_3")
REQUIRED = (*MEANS, *DC, "opacity", *SCALES, *QUATERNION)
ORIGIN_COMMENT = "origin"
FIX = "choose a .ply that a 3DGS program wrote, or export it again"


def write_ply(path: Path, gaussians: Gaussians, *, normals: bool = True) -> None:
    """Write the Gaussians as binary little-endian .ply: logits, log scales, f_rest with the colour channel outermost.

    A far origin stays out of the positions, which are float32, and is kept as a comment in the header.

    Args:
        path: the file, replaced when whole.
        gaussians: they are written exactly.
        normals: write the zeros that stand for normals. Hardly a viewer asks for them.
    """
    rest = rest_coefficients(gaussians)
    rest_names = tuple(f"f_rest_{i}" for i in range(rest.shape[1]))
    unused = NORMALS if normals else ()
    names = (*MEANS, *unused, *DC, *rest_names, "opacity", *SCALES, *QUATERNION)
    table = np.zeros(len(gaussians), [(name, "<f4") for name in names])
    _put(table, MEANS, gaussians.means)
    _put(table, DC, gaussians.sh[:, 0])
    _put(table, rest_names, rest)
    _put(table, ("opacity",), gaussians.opacity_logits[:, None])
    _put(table, SCALES, gaussians.log_scales)
    _put(table, QUATERNION, gaussians.quaternions)
    vertices = PlyElement.describe(table, "vertex")
    with replacing(path) as temporary:
        PlyData([vertices], byte_order="<", comments=origin_comment(gaussians)).write(str(temporary))


def rest_coefficients(gaussians: Gaussians) -> NDArray[np.float32]:
    """Spherical harmonics from degree 1 on as files have them: [N, 3 (K - 1)], the colour channel outermost."""
    n, k = gaussians.sh.shape[:2]
    return gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(n, 3 * (k - 1))


def origin_comment(gaussians: Gaussians) -> list[str]:
    """What a file's header says of a far origin; nothing of none."""
    if not gaussians.origin.any():
        return []
    return [" ".join([ORIGIN_COMMENT, *(float(c).hex() for c in gaussians.origin)])]


def read_ply(path: Path) -> Gaussians:
    """Read what `write_ply` or another 3DGS program wrote; what `write_ply` wrote comes back exactly.

    Raises:
        InputError: missing, cut short, not a .ply, a .ply without a 3DGS program's properties, or with values that are
            not finite.
    """
    try:
        data = PlyData.read(str(path))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (PlyHeaderParseError, PlyParseError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable .ply", found=error, fix=FIX) from error
    vertices = next((element for element in data.elements if element.name == "vertex"), None)
    names = () if vertices is None else tuple(p.name for p in vertices.properties)
    missing = [name for name in REQUIRED if name not in names]
    if vertices is None or missing:
        raise InputError(
            f"{path}: not a splat file",
            found=f"no {', '.join(missing[:4])}" + (" ..." if len(missing) > 4 else ""),
            expected=f"vertex properties {', '.join(REQUIRED)} and f_rest_*",
            fix=FIX,
        )
    rest_names = tuple(f"f_rest_{i}" for i in range(sum(name.startswith("f_rest_") for name in names)))
    try:
        degree_of(1 + len(rest_names) // 3)
        rest = _take(vertices, rest_names).reshape(len(vertices.data), 3, len(rest_names) // 3).transpose(0, 2, 1)
    except (ValueError, KeyError):
        raise InputError(
            f"{path}: cannot make spherical harmonics", found=f"{len(rest_names)} f_rest properties",
            expected="f_rest_0 to f_rest_(n - 1) with n = 0, 9, 24 or 45", fix=FIX,
        ) from None  # fmt: skip
    gaussians = Gaussians(
        means=_take(vertices, MEANS),
        quaternions=_take(vertices, QUATERNION),
        log_scales=_take(vertices, SCALES),
        opacity_logits=np.ascontiguousarray(_take(vertices, ("opacity",))[:, 0]),
        sh=np.ascontiguousarray(np.concatenate([_take(vertices, DC)[:, None], rest], axis=1)),
        origin=_origin(path, data),
    )
    return require_finite(path, gaussians, FIX)


def _put(table: NDArray, names: tuple[str, ...], values: NDArray) -> None:
    for name, column in zip(names, values.T, strict=True):
        table[name] = column


def _take(vertices: PlyElement, names: tuple[str, ...]) -> NDArray[np.float32]:
    out = np.empty((len(vertices.data), len(names)), np.float32)
    for index, name in enumerate(names):
        out[:, index] = vertices.data[name]
    return out


def _origin(path: Path, data: PlyData) -> NDArray[np.float64]:
    for comment in data.comments:
        words = comment.split()
        if words[:1] == [ORIGIN_COMMENT]:
            try:
                x, y, z = (float.fromhex(word) for word in words[1:])
            except ValueError:
                raise InputError(f"{path}: unreadable origin", found=comment, expected="three numbers") from None
            return np.array([x, y, z])
    return np.zeros(3)
