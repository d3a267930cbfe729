"""The unreduced photometric loss: what each pixel adds to it, for masks to learn from.

    l = mean over channels of (1 - lambda) |C^ - C| + lambda (1 - SSIM)

The same arithmetic as `photometric`, which sums the map up as it goes and keeps none.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import C1, C2, Target, filter_products, filter_vertically
from hydroviews.scene.images import Image


def loss_map(
    image: Image, target: Target, lambda_dssim: float = 0.2, buffers: BufferPool | None = None
) -> NDArray[np.float32]:
    """(1 - lambda) |C^ - C| + lambda (1 - SSIM) of every pixel [H, W], averaged over channels; 0 where hidden.

    Its mean is what `photometric_loss` returns.

    Args:
        image: rendered, float32 [H, W, 3].
        target: what it should look like.
        lambda_dssim: lambda.
        buffers: memory to reuse.

    Raises:
        ValueError: image and target differ in size.
    """
    height, width = image.shape[:2]
    if target.pixels.shape != (height, 3 * width):
        raise ValueError(f"image {image.shape} and target {target.pixels.shape} differ in size")
    buffers = buffers or BufferPool()
    if target.shown is not None:  # by selection, since a render may hold NaN there
        image = np.where(target.shown[..., None] > 0, image, np.float32(0))
    x = np.ascontiguousarray(image, np.float32).reshape(height, -1)
    rows = buffers.array("mask_rows", (3, *x.shape))
    planes = buffers.array("mask_planes", (3, *x.shape))
    filter_products(x, target.pixels, rows)
    filter_vertically(rows, planes)
    losses = (1 - lambda_dssim) * np.abs(target.pixels - x) + lambda_dssim * (1 - _similarity(target, planes))
    out = losses.reshape(height, width, 3).mean(axis=2)
    if target.shown is not None:
        out[target.shown == 0] = 0
    return np.asarray(out, np.float32)


def _similarity(target: Target, planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """SSIM [H, 3 W] from the filtered x, x^2 and x y of the render, planes [3, H, 3 W]."""
    mean, mean_square, mean_product = planes
    product, squares = mean * target.mean, mean * mean + target.mean * target.mean
    variances = mean_square + target.mean_square - squares
    return (2 * product + C1) * (2 * (mean_product - product) + C2) / ((squares + C1) * (variances + C2))
