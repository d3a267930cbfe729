# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The unreduced photometric loss: what each pixel adds to it, for masks to learn from.

The same arithmetic as `baselines.splatting.photometric`, which sums the map up as it goes and keeps none.
"""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from baselines.splatting.jit import kernel
from baselines.splatting.photometric import C1, C2, ONE, TWO, Target, filter_products, filter_vertically
from baselines.splatting.rasterizer import Workspace
from hydroviews.images import Image


@kernel
def combine(x, y, mean_y, mean_yy, planes, share, darker, out):
    """(1 - share) L1 + share (1 - SSIM) of rows [H, 3 W], averaged over the three channels into out [H, W].

    Args:
        planes: filtered x, x^2 and x y, [3, H, 3 W].
        share: lambda.
        darker: factor where y is darker than x.
    """
    height, width = out.shape
    l1_share, ssim_share, factor = np.float32(1 - share), np.float32(share), np.float32(darker)
    third = np.float32(1 / 3)
    for row in prange(height):
        for pixel in range(width):
            total, excess = np.float32(0), np.float32(0)
            for i in range(3 * pixel, 3 * pixel + 3):
                mx, my = planes[0, row, i], mean_y[row, i]
                a1, a2 = TWO * mx * my + C1, TWO * (planes[2, row, i] - mx * my) + C2
                b1 = mx * mx + my * my + C1
                b2 = (planes[1, row, i] - mx * mx) + (mean_yy[row, i] - my * my) + C2
                difference = y[row, i] - x[row, i]
                excess += difference
                total += l1_share * abs(difference) + ssim_share * (ONE - a1 * a2 / (b1 * b2))
            out[row, pixel] = third * total * (factor if excess < 0 else ONE)


def loss_map(
    image: Image, target: Target, ssim_share: float = 0.2, darker: float = 1.0, workspace: Workspace | None = None
) -> NDArray[np.float32]:
    """(1 - lambda) |C^ - C| + lambda (1 - SSIM) of every pixel [H, W], averaged over channels; 0 where hidden.

    Its mean is what `photometric_loss` returns, where `darker` is 1.

    Args:
        image: rendered, float32 [H, W, 3].
        target: what it should look like.
        ssim_share: lambda.
        darker: factor on the loss of pixels that are darker than rendered. Falling rain only adds light: with less
            than 1, masks learn less from the gaps between streaks, which a brightened render misses as well.
        workspace: buffers to reuse; the map is one of them.

    Raises:
        ValueError: image and target differ in size.
    """
    height, width = image.shape[:2]
    if target.pixels.shape != (height, 3 * width):
        raise ValueError(f"image {image.shape} and target {target.pixels.shape} differ in size")
    workspace = workspace or Workspace()
    if target.shown is not None:  # by selection, since a render may hold NaN there
        image = np.where(target.shown[..., None] > 0, image, np.float32(0))
    x = np.ascontiguousarray(image, np.float32).reshape(height, -1)
    rows = workspace.array("mask_rows", (3, *x.shape))
    planes = workspace.array("mask_planes", (3, *x.shape))
    out = workspace.array("mask_loss", (height, width))
    filter_products(x, target.pixels, rows)
    filter_vertically(rows, planes)
    combine(x, target.pixels, target.mean, target.mean_square, planes, ssim_share, darker, out)
    if target.shown is not None:
        out[target.shown == 0] = 0
    return out
