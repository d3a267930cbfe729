"""Streaks measured from pixels alone: which way they fall, and how many there are."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.streaks.recipe import StreakPattern, kernel, seed_image, supersampling

SMOOTHING = 1.5  # pixels; finer detail than this has the directions of the pixel grid
BORDER = 4  # pixels left out, where filters see a mirrored picture


def streak_angle(plane: NDArray[np.float32]) -> float | None:
    """The direction that most detail of a picture runs along, from its structure tensor (Bigun and Granlund 1987).

    Args:
        plane: [H, W], such as the cover by streaks.

    Returns:
        Degrees counter-clockwise from +x in [0, 180), 90 for vertical; None where nothing has a direction.
    """
    if min(plane.shape) <= 2 * BORDER:
        return None
    smooth = cv2.GaussianBlur(np.asarray(plane, np.float32), (0, 0), SMOOTHING)
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    right = cv2.Scharr(smooth, cv2.CV_32F, 1, 0)[inner].astype(np.float64)
    up = -cv2.Scharr(smooth, cv2.CV_32F, 0, 1)[inner].astype(np.float64)
    double = complex(float((right * right - up * up).sum()), float((2 * right * up).sum()))
    if abs(double) <= 1e-9 * float((right * right + up * up).sum()) or double == 0:
        return None
    return float(np.degrees(np.angle(double)) / 2 + 90) % 180  # streaks run across their gradient


def mean_angle(angles: NDArray[np.float64]) -> float:
    """Mean of directions in degrees, where 0 and 180 are the same; NaN of none."""
    if not len(angles):
        return float("nan")
    return float(np.degrees(np.angle(np.exp(2j * np.radians(angles)).mean())) / 2) % 180


def seed_density(layer: NDArray[np.float32], pattern: StreakPattern) -> float | None:
    """Share of a drawing's pixels that were seeds of a streak, from mean and variance of the layer.

    A layer is a K * N with an unknown gain a. For seeds of density rho and nearly equal height, its mean is
    a rho sum(K) and its variance a^2 rho (1 - rho) sum(K^2) (Campbell's theorem), so mean^2 / variance gives rho
    whatever the gain. K includes the pre-blur and the averaging of a supersampled drawing.

    Args:
        layer: S [H, W].
        pattern: whose length, angle and width fix K; its n is not used.

    Returns:
        The density, n / 25600 by the recipe; None where the picture is too small or without rain.
    """
    height, width = layer.shape
    factor = supersampling(width, height)
    border = -(-pattern.length // factor)
    inner = layer[border:-border, border:-border].astype(np.float64)
    if not inner.size or inner.var() == 0:
        return None
    ratio = inner.mean() ** 2 / inner.var()
    streak = np.pad(seed_image(kernel(pattern.length, pattern.angle, pattern.width)), factor)
    averaged = cv2.blur(streak, (factor, factor), borderType=cv2.BORDER_CONSTANT)
    odds = ratio * float(np.square(averaged).sum() / averaged.sum() ** 2)
    return float(odds / (1 + odds))
