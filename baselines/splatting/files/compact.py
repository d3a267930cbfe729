"""Smaller splat files: leave out what no picture shows, or what costs little, and pack the rest in few bits.

The compressed .ply of PlayCanvas (SuperSplat's own format, which most viewers read): runs of 256 neighbouring
Gaussians share the bounds of their positions, log scales and colours; within them a Gaussian takes 11 + 10 + 11 bits of
position, as many of log scale, 2 + 3 x 10 of rotation, 4 x 8 of colour and opacity, and 8 for every further
spherical-harmonic coefficient, which are cut off at -4 and 4.
"""

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.files.finite import require_finite
from baselines.splatting.files.ply import origin_comment, rest_coefficients
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.constants import MIN_ALPHA
from baselines.splatting.kernels.splats.sh_coefficients import coefficients
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes

INSTALL = ".venv/bin/pip install --constraint constraints.txt --editable '.[compression]'"
FIRST_LINES = b"ply\nformat binary_little_endian 1.0\n"
BITS = 10  # per axis of the order along which neighbours are found


def without_unseen(gaussians: Gaussians) -> Gaussians:
    """Only Gaussians that can show: one fainter than MIN_ALPHA in its middle leaves every pixel untouched."""
    least = np.log(MIN_ALPHA / (1 - MIN_ALPHA))
    return gaussians.select(gaussians.opacity_logits >= least)


def cut_to_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """Spherical harmonics up to `degree` alone.

    Raises:
        InputError: a degree that the Gaussians do not have.
    """
    if not 0 <= degree <= gaussians.sh_degree:
        raise InputError(
            f"--sh-degree {degree}: cannot be had", expected=f"0 to {gaussians.sh_degree}, what the model holds"
        )
    return replace(gaussians, sh=np.ascontiguousarray(gaussians.sh[:, : coefficients(degree)]))


def write_compressed_ply(path: Path, gaussians: Gaussians) -> None:
    """Write the Gaussians as PlayCanvas' compressed .ply, in another order; needs gsply.

    A far origin stays out of the positions and is kept as a comment in the header, as in `ply.write_ply`.

    Raises:
        InputError: no gsply, no Gaussians, or values that are not finite.
    """
    gsply = _import_gsply()
    if not len(gaussians):
        raise InputError(f"{path}: no Gaussians to write")
    require_finite(path, gaussians, "train the model again")
    near = gaussians.select(neighbouring_order(gaussians.means))
    content = gsply.compress_to_bytes(
        near.means,
        near.log_scales,
        near.quaternions,
        near.opacity_logits,
        np.ascontiguousarray(near.sh[:, 0]),
        rest_coefficients(near) if near.sh_degree else None,
    )
    comments = "".join(f"comment {comment}\n" for comment in origin_comment(near))
    write_bytes(path, content.replace(FIRST_LINES, FIRST_LINES + comments.encode(), 1))


def neighbouring_order(positions: NDArray[np.float32]) -> NDArray[np.int64]:
    """Indices [N] that bring neighbours together: along the Z-order curve (Morton 1966) through the bounding box."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    cells = (positions - low) / np.maximum(high - low, np.finfo(np.float32).tiny) * (2**BITS - 1)
    whole = cells.astype(np.int64)
    code = np.zeros(len(positions), np.int64)
    for bit in range(BITS):
        for axis in range(3):
            code |= ((whole[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _import_gsply() -> ModuleType:
    try:
        import gsply
    except ImportError as error:
        raise InputError("compressed .ply files need gsply", found=error, fix=INSTALL) from None
    return gsply
