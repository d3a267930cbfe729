"""Falling rain as motion-blurred noise: S = K(l, theta, w) * N(n) (DeRainGS, Eq. 1).

The paper's wording matches a widely used OpenCV recipe term by term, which fixes the units:

* n: a pixel is a seed where uniform noise on [0, 256) is at least 256 - n / 100, so the density is n / 25600;
* l: side of the kernel in pixels; the streak itself is scaled by 1 - l / 100;
* theta: degrees counter-clockwise from +x, so 90 is vertical rain;
* w: side of the Gaussian that gives the streak its thickness, odd.

Lengths are pixels of a drawing at least REFERENCE_LONG_SIDE wide. A smaller image gets a larger drawing,
averaged down, so that the same pattern looks the same at every size.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.images import Image

REFERENCE_LONG_SIDE = 800
PRE_BLUR = np.array([[0, 0.1, 0], [0.1, 8, 0.1], [0, 0.1, 0]], np.float32)


@dataclass(frozen=True)
class StreakPattern:
    """What all views of one pattern share. Ranges are the paper's."""

    n: int  # noise level, 100..300
    length: int  # kernel side in pixels, 20..40
    angle: float  # degrees counter-clockwise from +x, 40..120
    width: int  # side of the thickness Gaussian in pixels: 3, 5 or 7
    brightness: float = 0.8  # the encoded value of a fully covered pixel


def draw_pattern(rng: np.random.Generator) -> StreakPattern:
    """Draw n, l, theta and w uniformly from the paper's ranges."""
    return StreakPattern(
        n=int(rng.integers(100, 301)),
        length=int(rng.integers(20, 41)),
        angle=float(rng.uniform(40, 120)),
        width=int(rng.choice([3, 5, 7])),
    )


def supersampling(width: int, height: int) -> int:
    """How many times larger than the image streaks are drawn."""
    return max(1, -(-REFERENCE_LONG_SIDE // max(width, height)))


def noise(n: float, width: int, height: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Seeds N(n): uniform noise [H, W] in [0, 256), zero but for the brightest n / 25600 of it."""
    values = rng.uniform(0, 256, (height, width)).astype(np.float32)
    values[values < 256 - n / 100] = 0
    return values


def kernel(length: int, angle: float, width: int) -> NDArray[np.float32]:
    """K(l, theta, w) [l, l]: a diagonal turned to `angle`, shrunk by 1 - l / 100, blurred to `width`."""
    if length < 1 or length >= 100:
        raise ValueError(f"streak length {length}, expected 1 to 99 pixels")
    if width < 1 or width % 2 == 0:
        raise ValueError(f"streak width {width}, expected an odd number of pixels")
    # An image diagonal runs down to the right: it stands upright after a turn of -45 degrees.
    turn = cv2.getRotationMatrix2D((length / 2, length / 2), angle - 90 - 45, 1 - length / 100)
    line = cv2.warpAffine(np.eye(length, dtype=np.float32), turn, (length, length))
    return np.asarray(cv2.GaussianBlur(line, (width, width), 0), np.float32)


def streak_layer(pattern: StreakPattern, width: int, height: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """One view's rain S [H, W] in [0, 1]: blurred seeds, normalised from minimum to maximum."""
    factor = supersampling(width, height)
    seeds = cv2.filter2D(noise(pattern.n, width * factor, height * factor, rng), -1, PRE_BLUR)
    rain = cv2.filter2D(seeds, -1, kernel(pattern.length, pattern.angle, pattern.width))
    low, high = float(rain.min()), float(rain.max())
    rain = (rain - low) / (high - low) if high > low else np.zeros_like(rain)
    return np.asarray(cv2.resize(rain, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def composite(background: Image, layer: NDArray, brightness: float) -> Image:
    """Rain over an image: B (1 - S) + brightness S, in encoded values as the recipe has it.

    Args:
        background: [H, W, 3], sRGB-encoded, [0, 1].
        layer: S [H, W], [0, 1].
        brightness: encoded value of a fully covered pixel.
    """
    cover = layer.astype(np.float32)[..., None]
    return background * (1 - cover) + np.float32(brightness) * cover
