"""Smooth noise, planes for half the size, and numbers of which small ones are as frequent as large ones."""

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]  # [H, W]


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number from low to high, whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def clouds(rng: np.random.Generator, width: int, height: int, sigma: float) -> Plane:
    """Smooth noise of mean 0 and unit spread, drawn coarsely: [H, W]; `sigma` is its size in pixels."""
    cell = max(1.0, sigma / 2)
    rows, columns = (int(np.ceil(length / cell)) + 3 for length in (height, width))
    coarse = cv2.GaussianBlur(rng.normal(size=(rows, columns)).astype(np.float32), (0, 0), sigma / cell)
    fine = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray((fine - fine.mean()) / max(float(fine.std()), 1e-6), np.float32)


def halved(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Averages of 2x2 pixels, of [H, W] or [H, W, C]."""
    height, width = plane.shape[:2]
    return np.asarray(cv2.resize(plane, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.float32)


def mean_colour(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """The mean [3] of a picture [H, W, 3]; three times faster than numpy's."""
    return np.array(cv2.mean(picture)[:3], np.float32)


def tinted(rng: np.random.Generator, brightness: float, cast: float) -> NDArray[np.float32]:
    """An encoded colour [3], in [0, 1], whose channels differ from a brightness by a share `cast` of it at most."""
    return np.clip(brightness * (1 + cast * rng.uniform(-1, 1, 3)), 0, 1).astype(np.float32)
