"""The photometric loss and its gradient (Kerbl et al. 2023, equation 7).

    loss = (1 - lambda) mean |x - y| + lambda (1 - mean SSIM)
    SSIM = (2 mu_x mu_y + C1) (2 sigma_xy + C2) / ((mu_x^2 + mu_y^2 + C1) (sigma_x^2 + sigma_y^2 + C2))

SSIM after Wang et al. 2004, equation 13: an 11x11 Gaussian window of sigma 1.5, zero outside the image, per channel,
constants for values in [0, 1]. `loss_sweep.py` calculates it.

Pixels have weights w from 0 on; hidden ones have 0. With the window G, zero outside, and N pixels and channels,

    W = G(w) / G(1),  mu_x = G(w x) / W,  sigma_x^2 = G(w x^2) / W - mu_x^2,  sigma_xy = G(w x y) / W - mu_x mu_y
    loss = 1/N sum w ((1 - lambda) |x - y| + lambda (1 - SSIM))

What lies outside the image weighs as much as the inside of the same window does on average, so a common factor on w
is one on the loss. Where w is 0, nothing in the target or in the render changes the loss or its gradient.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.loss_sweep import BAND, FULL, STRIP, sweep
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

Plane = NDArray[np.float32]
VALUES = np.arange(256, dtype=np.float32) / FULL  # of 8 bits
NONE, NOTHING_HIDDEN = np.zeros((0, 0), np.float32), np.zeros((0, 0), bool)


@dataclass(frozen=True)
class Target:
    """An image to be matched; it is filtered anew in every step, so that nothing but its pixels is kept."""

    pixels: NDArray[np.uint8]  # [H, W, 3]
    ignored: Ignored | None = None  # bool [H, W], what is hidden; None where nothing is

    @property
    def image(self) -> Image:
        """The pixels as float32 in [0, 1], 0 where hidden."""
        values: Image = np.asarray(cv2.LUT(self.pixels, VALUES), np.float32)
        return values if self.ignored is None else np.where(self.ignored[..., None], np.float32(0), values)

    @property
    def shown(self) -> Plane | None:
        """[H, W], 0 where hidden, else 1; None where nothing is hidden."""
        return None if self.ignored is None else np.where(self.ignored, np.float32(0), np.float32(1))


def prepare_target(image: NDArray[np.uint8], ignored: Ignored | None = None) -> Target:
    """A target from an image [H, W, 3] of which the pixels `ignored` [H, W] are hidden.

    Raises:
        ValueError: image and mask differ in size.
    """
    if ignored is not None and ignored.shape != image.shape[:2]:
        raise ValueError(f"image {image.shape} and mask {ignored.shape} differ in size")
    hidden = ignored is not None and ignored.any()
    return Target(np.ascontiguousarray(image), np.ascontiguousarray(ignored, bool) if hidden else None)


def photometric_loss(
    image: Image,
    target: Target,
    lambda_dssim: float = 0.2,
    weights: Plane | None = None,
    buffers: BufferPool | None = None,
) -> tuple[float, Image]:
    """The loss averaged over pixels and channels, and its gradient by the image [H, W, 3].

    Args:
        image: float32 [H, W, 3].
        target: what it should look like; what is hidden of it counts for nothing.
        lambda_dssim: lambda in (1 - lambda) L1 + lambda (1 - SSIM).
        weights: [H, W] factors from 0 on, on each pixel's share of the loss and of SSIM's windows (0 leaves it out);
            the average stays over all pixels.
        buffers: memory to reuse; the gradient is one of them.

    Raises:
        ValueError: image, target and weights differ in size.
    """
    gradient = (buffers or BufferPool()).array("g_image", image.shape)
    factors = NONE if weights is None else np.ascontiguousarray(weights, np.float32)
    return compare(image, target, lambda_dssim, factors, NONE, gradient.reshape(len(image), -1)), gradient


def compare(
    image: Image, target: Target, lambda_dssim: float, weights: Plane, losses: Plane, gradient: NDArray[np.float32]
) -> float:
    """The loss averaged over pixels and channels; see `loss_sweep.sweep` for the others.

    Raises:
        ValueError: image, target and weights differ in size.
    """
    height, width = image.shape[:2]
    if target.pixels.shape != image.shape or weights.shape not in ((height, width), NONE.shape):
        found = weights.shape if weights.size else None
        raise ValueError(f"image {image.shape}, target {target.pixels.shape} and weights {found} differ in size")
    ignored = NOTHING_HIDDEN if target.ignored is None else target.ignored
    x = np.ascontiguousarray(image, np.float32).reshape(height, -1)
    y = target.pixels.reshape(height, -1)
    sums = np.empty((-(-height // BAND), -(-3 * width // STRIP)))
    sweep(x, y, ignored, weights, lambda_dssim, sums, losses, gradient)
    return float(sums.sum()) / x.size
