"""Tileable textures as arrays: an sRGB colour [N, N, 3] and a height [N, N], both in [0, 1].

Cycles shades an image many times faster than the same pattern made of noise nodes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

SIZE = 512  # pixels along a side

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Texture:
    """One period of a pattern."""

    colour: Array  # [SIZE, SIZE, 3], sRGB-encoded
    height: Array  # [SIZE, SIZE]


Pattern = Callable[[np.random.Generator, Array, Array], Texture]  # (rng, dark colour, light colour)


def noise(rng: np.random.Generator, exponent: float = 1.9, lowest: float = 2.0) -> Array:
    """Fractal noise [SIZE, SIZE] spread about evenly over [0, 1]: amplitude ~ frequency^-exponent."""
    frequency = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)) * SIZE
    phases = rng.standard_normal(frequency.shape) + 1j * rng.standard_normal(frequency.shape)
    spectrum = phases / np.maximum(frequency, lowest) ** exponent
    spectrum[0, 0] = 0
    values = np.fft.irfft2(spectrum, s=(SIZE, SIZE))
    return ndtr(values / values.std())


def blend(dark: ArrayLike, light: ArrayLike, weight: Array) -> Array:
    """Colours between two: [..., 3] for weights [...], clipped to [0, 1]."""
    dark, light = np.asarray(dark, float), np.asarray(light, float)
    return dark + (light - dark) * np.clip(weight, 0, 1)[..., None]


def weathered(rng: np.random.Generator, colour: Array, strength: float = 0.3) -> Array:
    """Stains, grain and fine speckles over a colour."""
    stains = 1 - strength * noise(rng)
    grain = 1 - 0.6 * strength * noise(rng, 1.0, 8)
    speckles = 1 - 0.25 * strength * rng.random((SIZE, SIZE))
    return np.clip(colour * (stains * grain * speckles)[..., None] * (1 + 0.5 * strength), 0, 1)


def bricks(rows: int, columns: int, mortar: float = 0.06) -> Pattern:
    """Running bond: every other row is shifted by half a brick."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        wobble = 0.03 * (noise(rng, 1.6) - 0.5)
        row = y * rows + wobble * rows / 4
        along = (x + wobble) * columns + 0.5 * (np.floor(row) % 2)
        edge = np.minimum(to_edge(along) * rows / columns, to_edge(row))
        brick = np.clip((edge - mortar) / mortar, 0, 1)
        tone = rng.random((rows, columns))[np.floor(row).astype(int) % rows, np.floor(along).astype(int) % columns]
        colour = weathered(rng, blend(dark, light, tone))
        joint = weathered(rng, np.broadcast_to([0.68, 0.65, 0.6], colour.shape), 0.4)
        height = brick * (0.75 + 0.25 * noise(rng, 1.2, 8))
        return Texture(colour * brick[..., None] + joint * (1 - brick[..., None]), height)

    return pattern


def stones(count: int, gap: float = 0.14, shadow: float = 0.3) -> Pattern:
    """Irregular cells: cobbles, or leaves if there are many and they are shaded deeply."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        bent = 0.02 * (noise(rng) - 0.5)
        centres = rng.random((count, 2))
        tiled = np.concatenate([centres + np.array([i, j]) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        distance, nearest = cKDTree(tiled).query(np.stack([x + bent, y - bent], -1).reshape(-1, 2), k=2)
        edge = ((distance[:, 1] - distance[:, 0]) * count**0.5).reshape(SIZE, SIZE)
        stone = np.clip(edge / gap, 0, 1)
        tone = rng.random(count)[nearest[:, 0] % count].reshape(SIZE, SIZE)
        colour = weathered(rng, blend(dark, light, 0.8 * tone + 0.2 * noise(rng, 1.2, 8)))
        return Texture(colour * (shadow + (1 - shadow) * stone[..., None]), np.sqrt(stone) * (0.8 + 0.2 * tone))

    return pattern


def planks(count: int) -> Pattern:
    """Boards along y with grain; each board has a tone of its own."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        _, x = grid()
        board = np.floor(x * count).astype(int) % count
        shift = rng.random(count)[board]
        rings = 0.5 + 0.5 * np.sin(2 * np.pi * (6 * x * count / 4 + 2.5 * noise(rng, 2.2) + 7 * shift))
        tone = 0.45 * rings + 0.25 * noise(rng, 1.1, 6) + 0.45 * rng.random(count)[board] - 0.1
        groove = np.clip(to_edge(x * count) / 0.05, 0, 1)
        colour = weathered(rng, blend(dark, light, tone)) * (0.3 + 0.7 * groove[..., None])
        return Texture(colour, groove * (0.8 + 0.2 * rings))

    return pattern


def shingles(rows: int, columns: int) -> Pattern:
    """Roof tiles: overlapping rows with round lower ends."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        across = x * columns
        scallop = 0.35 * (np.abs((across % 1) - 0.5) * 2) ** 2
        row = y * rows + scallop
        tone = rng.random((rows, columns))[np.floor(row).astype(int) % rows, np.floor(across).astype(int) % columns]
        fall = row % 1
        edge = np.clip(np.minimum(fall / 0.12, to_edge(across) / 0.04), 0, 1)
        colour = weathered(rng, blend(dark, light, 0.75 * tone + 0.25 * fall))
        return Texture(colour * (0.3 + 0.7 * edge[..., None]), fall * edge)

    return pattern


def checks(count: int) -> Pattern:
    """Glazed tiles in two colours with thin joints."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        which = (np.floor(x * count) + np.floor(y * count)) % 2
        joint = np.clip(np.minimum(to_edge(x * count), to_edge(y * count)) / 0.03, 0, 1)
        colour = weathered(rng, blend(dark, light, 0.85 * which + 0.15 * noise(rng, 1.2, 8)), 0.2)
        return Texture(colour * (0.45 + 0.55 * joint[..., None]), joint)

    return pattern


def stripes(count: int) -> Pattern:
    """Painted or woven bands across y."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, _ = grid()
        band = np.clip(6 * np.sin(2 * np.pi * (y * count + 0.1 * noise(rng, 2.2))) + 0.5, 0, 1)
        return Texture(weathered(rng, blend(dark, light, band), 0.25), 0.3 * noise(rng, 1.0, 16))

    return pattern


def rough(exponent: float = 1.6) -> Pattern:
    """Plaster, stone, rusty metal, soil: two tones of fractal noise."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        coarse, fine = noise(rng, exponent), noise(rng, 1.0, 10)
        return Texture(weathered(rng, blend(dark, light, 0.65 * coarse + 0.35 * fine)), 0.5 * coarse + 0.5 * fine)

    return pattern


def grid() -> tuple[Array, Array]:
    """y and x of the pixel centres, each [SIZE, SIZE] in [0, 1]."""
    y, x = (np.mgrid[0:SIZE, 0:SIZE] + 0.5) / SIZE
    return y, x


def to_edge(cells: Array) -> Array:
    """Distance to the nearest whole number."""
    return np.minimum(cells % 1, 1 - cells % 1)
