# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The photometric loss and its gradient, fused (Kerbl et al. 2023, equation 7).

    loss = (1 - lambda) mean |x - y| + lambda (1 - mean SSIM)
    SSIM = (2 mu_x mu_y + C1) (2 sigma_xy + C2) / ((mu_x^2 + mu_y^2 + C1) (sigma_x^2 + sigma_y^2 + C2))

SSIM after Wang et al. 2004, equation 13: an 11x11 Gaussian window of sigma 1.5, zero outside the image, per channel,
constants for values in [0, 1]. Rows are [H, 3 W] with the channels interleaved, so a horizontal tap is a step of three.

Hidden pixels count as lying outside the image: windows see zero there in both pictures, and no loss is taken at them.
So nothing that stands in them, in the target or in the render, changes the loss or its gradient.
"""

from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.jit import inlined, kernel
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

RADIUS = 5
SIGMA = 1.5
PAD = 3 * RADIUS
_WINDOW = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * SIGMA**2))
# taps at distance 0 to 5
TAPS = tuple(float(t) for t in (_WINDOW / _WINDOW.sum()).astype(np.float32)[RADIUS:])
T0, T1, T2, T3, T4, T5 = (np.float32(t) for t in TAPS)
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
ONE, TWO = np.float32(1), np.float32(2)
BANDS = 16  # rows are shared out in as many bands, whatever the number of threads


@dataclass(frozen=True)
class Target:
    """An image to be matched, with the filtered planes that stay the same from step to step; each [H, 3 W]."""

    pixels: NDArray[np.float32]
    mean: NDArray[np.float32]
    mean_square: NDArray[np.float32]
    shown: NDArray[np.float32] | None = None  # [H, W], 0 where hidden, else 1; None where nothing is hidden


@inlined
def filter_row(padded, n, out):
    """Horizontal window over a row that has PAD zeros on both sides."""
    for i in range(n):
        out[i] = (
            T0 * padded[i + 15]
            + T1 * (padded[i + 12] + padded[i + 18])
            + T2 * (padded[i + 9] + padded[i + 21])
            + T3 * (padded[i + 6] + padded[i + 24])
            + T4 * (padded[i + 3] + padded[i + 27])
            + T5 * (padded[i] + padded[i + 30])
        )


@inlined
def filter_column(rows, y, n, zeros, out):
    """Vertical window at row y; rows outside the image are zero."""
    height = rows.shape[0]
    centre = rows[y]
    for i in range(n):
        out[i] = T0 * centre[i]
    for k in range(1, RADIUS + 1):
        tap = T1 if k == 1 else (T2 if k == 2 else (T3 if k == 3 else (T4 if k == 4 else T5)))
        above = rows[y - k] if y >= k else zeros
        below = rows[y + k] if y + k < height else zeros
        for i in range(n):
            out[i] += tap * (above[i] + below[i])


@kernel
def filter_products(x, y, planes):
    """Horizontally filtered x, x^2 and x y into planes [3, H, 3 W]."""
    height, n = x.shape
    for band in prange(BANDS):
        padded = np.zeros((3, n + 2 * PAD), np.float32)
        a, b, c = padded[0], padded[1], padded[2]
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            x_row, y_row = x[row], y[row]
            for i in range(n):
                value = x_row[i]
                a[i + PAD], b[i + PAD], c[i + PAD] = value, value * value, value * y_row[i]
            filter_row(a, n, planes[0, row])
            filter_row(b, n, planes[1, row])
            filter_row(c, n, planes[2, row])


@kernel
def filter_vertically(planes, out):
    """Vertical window over planes [P, H, n]."""
    height, n = planes.shape[1], planes.shape[2]
    for band in prange(BANDS):
        zeros = np.zeros(n, np.float32)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            for plane in range(planes.shape[0]):
                filter_column(planes[plane], row, n, zeros, out[plane, row])


@kernel
def compare(x, y, mean_y, mean_yy, weights, share, planes, out_planes, sums, gradient):
    """SSIM and L1 with the L1 part of the gradient; the three SSIM derivatives, filtered horizontally, in out_planes.

    Args:
        weights: [H, W] per pixel, or [0, 0] for one everywhere.
        share: lambda.
        planes: from `filter_products`.
        sums: output [BANDS], weighted losses.
    """
    height, n = x.shape
    weighted = weights.shape[0] > 0
    l1_share, lambda_dssim = np.float32(1 - share), np.float32(share)
    inverse_count = np.float32(1 / (height * n))
    for band in prange(BANDS):
        padded = np.zeros((3, n + 2 * PAD), np.float32)
        by_mean, by_square, by_product = padded[0], padded[1], padded[2]
        scratch = np.empty((5, n), np.float32)
        mean_x, mean_xx, mean_xy, loss, weight = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
        zeros = np.zeros(n, np.float32)
        weight[:] = ONE
        total = 0.0
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            filter_column(planes[0], row, n, zeros, mean_x)
            filter_column(planes[1], row, n, zeros, mean_xx)
            filter_column(planes[2], row, n, zeros, mean_xy)
            my_row, myy_row, x_row, y_row, g_row = mean_y[row], mean_yy[row], x[row], y[row], gradient[row]
            if weighted:
                for i in range(n // 3):
                    weight[3 * i] = weight[3 * i + 1] = weight[3 * i + 2] = weights[row, i]
            for i in range(n):
                mx, my = mean_x[i], my_row[i]
                a1, a2 = TWO * mx * my + C1, TWO * (mean_xy[i] - mx * my) + C2
                b1, b2 = mx * mx + my * my + C1, (mean_xx[i] - mx * mx) + (myy_row[i] - my * my) + C2
                inverse = ONE / (b1 * b2)
                ssim = a1 * a2 * inverse
                d_product = TWO * a1 * inverse
                d_square = -ssim * b1 * inverse
                d_mean = TWO * my * a2 * inverse - TWO * mx * ssim * b2 * inverse - my * d_product - TWO * mx * d_square
                w = weight[i]
                by_mean[i + PAD], by_square[i + PAD], by_product[i + PAD] = w * d_mean, w * d_square, w * d_product
                difference = x_row[i] - y_row[i]
                sign = ONE if difference > 0 else (-ONE if difference < 0 else np.float32(0))
                g_row[i] = w * l1_share * inverse_count * sign
                loss[i] = w * (l1_share * abs(difference) + lambda_dssim * (ONE - ssim))
            total += loss.sum()
            filter_row(by_mean, n, out_planes[0, row])
            filter_row(by_square, n, out_planes[1, row])
            filter_row(by_product, n, out_planes[2, row])
        sums[band] = total


@kernel
def add_ssim_gradient(x, y, share, planes, gradient):
    """Finish the window over the SSIM derivatives and add them to the gradient."""
    height, n = x.shape
    factor = np.float32(-share / (height * n))
    for band in prange(BANDS):
        scratch = np.empty((3, n), np.float32)
        by_mean, by_square, by_product = scratch[0], scratch[1], scratch[2]
        zeros = np.zeros(n, np.float32)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            filter_column(planes[0], row, n, zeros, by_mean)
            filter_column(planes[1], row, n, zeros, by_square)
            filter_column(planes[2], row, n, zeros, by_product)
            x_row, y_row, g_row = x[row], y[row], gradient[row]
            for i in range(n):
                g_row[i] += factor * (by_mean[i] + TWO * x_row[i] * by_square[i] + y_row[i] * by_product[i])


def prepare_target(image: NDArray, ignored: Ignored | None = None) -> Target:
    """A target from an image [H, W, 3], uint8 or float32 in [0, 1], of which the pixels `ignored` [H, W] are hidden.

    Raises:
        ValueError: image and mask differ in size.
    """
    if ignored is not None and ignored.shape != image.shape[:2]:
        raise ValueError(f"image {image.shape} and mask {ignored.shape} differ in size")
    values = image.astype(np.float32) / np.float32(255) if image.dtype == np.uint8 else image
    shown = None
    if ignored is not None and ignored.any():
        shown = np.where(ignored, np.float32(0), np.float32(1))
        values = np.where(ignored[..., None], np.float32(0), values)
    pixels = np.ascontiguousarray(values, np.float32).reshape(image.shape[0], -1)
    planes = np.empty((3, *pixels.shape), np.float32)
    filter_products(pixels, pixels, planes)
    filtered = np.empty((2, *pixels.shape), np.float32)
    filter_vertically(planes[:2], filtered)
    return Target(pixels, filtered[0], filtered[1], shown)


NO_WEIGHTS = np.zeros((0, 0), np.float32)


def photometric_loss(
    image: Image,
    target: Target,
    lambda_dssim: float = 0.2,
    weights: NDArray[np.float32] | None = None,
    buffers: BufferPool | None = None,
) -> tuple[float, Image]:
    """The loss averaged over pixels and channels, and its gradient by the image [H, W, 3].

    Args:
        image: float32 [H, W, 3].
        target: what it should look like; what is hidden of it counts for nothing.
        lambda_dssim: lambda in (1 - lambda) L1 + lambda (1 - SSIM).
        weights: [H, W] factors on each pixel's share of the loss (0 leaves it out); the average stays over all pixels.
        buffers: memory to reuse; the gradient is one of them.

    Raises:
        ValueError: image, target and weights differ in size.
    """
    height, width = image.shape[:2]
    if target.pixels.shape != (height, 3 * width) or (weights is not None and weights.shape != (height, width)):
        found = None if weights is None else weights.shape
        raise ValueError(f"image {image.shape}, target {target.pixels.shape} and weights {found} differ in size")
    buffers = buffers or BufferPool()
    if target.shown is not None:  # by selection, since a render may hold NaN there
        image = np.where(target.shown[..., None] > 0, image, np.float32(0))
        weights = target.shown if weights is None else weights * target.shown
    x = np.ascontiguousarray(image, np.float32).reshape(height, -1)
    planes = buffers.array("loss_planes", (3, *x.shape))
    more_planes = buffers.array("loss_planes2", (3, *x.shape))
    gradient = buffers.array("g_image", x.shape)
    sums = buffers.array("loss_sums", (BANDS,), np.float64)
    filter_products(x, target.pixels, planes)
    factors = NO_WEIGHTS if weights is None else np.ascontiguousarray(weights, np.float32)
    arguments = (target.pixels, target.mean, target.mean_square, factors, lambda_dssim, planes, more_planes)
    compare(x, *arguments, sums, gradient)
    add_ssim_gradient(x, target.pixels, lambda_dssim, more_planes, gradient)
    if target.shown is not None:
        gradient.reshape(image.shape)[target.shown == 0] = 0
    return float(sums.sum()) / x.size, gradient.reshape(image.shape)
