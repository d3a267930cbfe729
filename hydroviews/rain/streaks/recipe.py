"""Falling rain as motion-blurred noise: S = K(l, theta, w) * N(n) (DeRainGS, Eq. 1).

The paper's wording matches a widely used OpenCV recipe term by term, which fixes the units:

* n: a pixel is a seed where uniform noise on [0, 256) is at least 256 - n / 100, so the density is n / 25600;
* l: side of the kernel in pixels; the streak itself is scaled by 1 - l / 100;
* theta: degrees counter-clockwise from +x, so 90 is vertical rain;
* w: side of the Gaussian that gives the streak its thickness, odd.

Lengths are pixels of a drawing at least REFERENCE_LONG_SIDE wide. A smaller image gets a larger drawing,
averaged down, so that the same pattern looks the same at every size.

About one pixel in a hundred is a seed, so the seeds alone are drawn, and the convolution adds one copy of the kernel
a seed (`convolution`); `reference` is the same recipe with every pixel of noise.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.streaks.convolution import Seeds, convolve
from hydroviews.scene.images import Image

REFERENCE_LONG_SIDE = 800
PRE_BLUR = np.array([[0, 0.1, 0], [0.1, 8, 0.1], [0, 0.1, 0]], np.float32)
LEVELS = 256  # noise is uniform on [0, LEVELS)
BAND = 3.0  # of noise values drawn at a time; holds all seeds up to n = 300, the paper's most


@dataclass(frozen=True)
class StreakPattern:
    """What all views of one pattern share."""

    n: float  # noise level, the paper's 100..300
    length: int  # kernel side in pixels, 20..40
    angle: float  # degrees counter-clockwise from +x, 40..120
    width: int  # side of the thickness Gaussian in pixels: 3, 5 or 7
    brightness: float = 0.8  # the encoded value of a fully covered pixel


@dataclass(frozen=True)
class Ranges:
    """What n, l and w are drawn from, ends included."""

    n: tuple[int, int]
    length: tuple[int, int]
    widths: tuple[int, ...]


PAPER = Ranges((100, 300), (20, 40), (3, 5, 7))
GRADES = (Ranges((100, 150), (20, 26), (3,)), Ranges((170, 230), (26, 34), (5,)), Ranges((260, 300), (34, 40), (7,)))


def draw_pattern(rng: np.random.Generator, grade: int | None = None) -> StreakPattern:
    """Draw n, l, theta and w uniformly.

    Args:
        rng: of the pattern.
        grade: 0, 1 or 2 for the light, medium or heavy part of the paper's ranges; None for all of them.
    """
    ranges = PAPER if grade is None else GRADES[grade]
    return StreakPattern(
        n=float(rng.integers(*ranges.n, endpoint=True)),
        length=int(rng.integers(*ranges.length, endpoint=True)),
        angle=float(rng.uniform(40, 120)),
        width=int(rng.choice(ranges.widths)),
    )


def supersampling(width: int, height: int) -> int:
    """How many times larger than the image streaks are drawn."""
    return max(1, -(-REFERENCE_LONG_SIDE // max(width, height)))


def draw_seeds(n: float, width: int, height: int, rng: np.random.Generator) -> Seeds:
    """The seeds of N(n): the pixels where uniform noise on [0, 256) reaches 256 - n / 100, and the noise there.

    Noise is drawn from the top down in bands of values: a pixel that no higher band took is in a band of width BAND
    with the chance that leaves. So a larger n keeps every seed of a smaller one from the same generator.

    Raises:
        ValueError: n below 0, or above 25600, where every pixel is a seed.
    """
    if not 0 <= n <= 100 * LEVELS:
        raise ValueError(f"noise level {n}, expected 0 to {100 * LEVELS}")
    pixels, least = width * height, LEVELS - n / 100
    places, values = np.zeros(0, np.int64), np.zeros(0)
    top = float(LEVELS)
    while top > least:
        bottom = max(top - BAND, 0.0)
        count = rng.binomial(pixels, (top - bottom) / top)
        here = rng.choice(pixels, count, replace=False, shuffle=False)
        here = here[~np.isin(here, places)] if len(places) else here
        places = np.concatenate([places, here])
        values = np.concatenate([values, rng.uniform(bottom, top, len(here))])
        top = bottom
    kept = np.flatnonzero(values >= least)
    kept = kept[np.argsort(places[kept])]
    return Seeds(places[kept] // width, places[kept] % width, values[kept].astype(np.float32))


def noise(n: float, width: int, height: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """N(n) [H, W]: `draw_seeds` as a picture, zero where there is no seed."""
    seeds = draw_seeds(n, width, height, rng)
    picture = np.zeros((height, width), np.float32)
    picture[seeds.rows, seeds.columns] = seeds.values
    return picture


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


def seed_image(k: NDArray) -> NDArray[np.float64]:
    """What one seed of value 1 becomes, pre-blur and kernel in one: [l + 2, l + 2], to correlate with.

    The pre-blur is symmetric, so that blurring a picture that is mirrored at its borders mirrors the blurred
    picture: both steps together are one, at the borders too.
    """
    padded = np.pad(k.astype(np.float64), 2)
    side = len(k) + 2
    shifted = (PRE_BLUR[y, x] * padded[y : y + side, x : x + side] for y in range(3) for x in range(3))
    return np.sum(list(shifted), axis=0)


def streak_layer(pattern: StreakPattern, width: int, height: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """One view's rain S [H, W] in [0, 1]: blurred seeds, normalised from minimum to maximum."""
    factor = supersampling(width, height)
    seeds = draw_seeds(pattern.n, width * factor, height * factor, rng)
    streak = seed_image(kernel(pattern.length, pattern.angle, pattern.width))
    rain = convolve(seeds, streak, width * factor, height * factor)
    return np.asarray(cv2.resize(normalised(rain), (width, height), interpolation=cv2.INTER_AREA), np.float32)


def normalised(rain: NDArray) -> NDArray:
    """From 0 at the minimum to 1 at the maximum; 0 everywhere where these are the same."""
    low, high = rain.min(), rain.max()
    return (rain - low) * (1 / (high - low)) if high > low else np.zeros_like(rain)


def composite(background: Image, layer: NDArray, brightness: float) -> Image:
    """Rain over an image: B (1 - S) + brightness S, in encoded values as the recipe has it.

    Args:
        background: [H, W, 3], sRGB-encoded, [0, 1].
        layer: S [H, W], [0, 1].
        brightness: encoded value of a fully covered pixel.
    """
    cover = layer.astype(np.float32)[..., None]
    return background * (1 - cover) + np.float32(brightness) * cover
