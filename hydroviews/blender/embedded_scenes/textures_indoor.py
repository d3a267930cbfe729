"""Tileable textures of rooms and shop windows, in the manner of `textures`."""

import numpy as np

from hydroviews.blender.embedded_scenes.textures import (
    SIZE,
    Array,
    Pattern,
    Texture,
    blend,
    grid,
    noise,
    to_edge,
    weathered,
)


def parquet(cells: int, strips: int) -> Pattern:
    """Squares of parallel strips that lie across in every other square; `cells` is even."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        turned = (np.floor(x * cells) + np.floor(y * cells)) % 2 == 0
        across = np.where(turned, y, x) * float(cells * strips)
        along = np.where(turned, x, y) * float(cells)
        tones = rng.random((2, cells * strips, cells))
        cell = np.floor(along).astype(int) % cells
        tone = tones[turned.astype(int), np.floor(across).astype(int) % (cells * strips), cell]
        grain = 0.5 + 0.5 * np.sin(2 * np.pi * (2 * across + 3 * noise(rng, 2.0) + 9 * tone))
        gap = np.minimum(to_edge(across) / 0.06, to_edge(along) / (0.06 / strips))
        joint = np.clip(gap, 0, 1)
        colour = weathered(rng, blend(dark, light, 0.65 * tone + 0.3 * grain), 0.2)
        return Texture(colour * (0.35 + 0.65 * joint[..., None]), joint)

    return pattern


def damask(count: int) -> Pattern:
    """Wallpaper: a leafy motif in staggered rows, on a paler ground."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        u, v = 2 * np.pi * count * x, 2 * np.pi * count * y
        leaf = np.cos(u) * np.cos(v) + 0.6 * np.cos(2 * u + 1.5 * np.sin(v)) * np.sin(2 * v)
        leaf += 0.5 * np.cos(4 * u) * np.cos(3 * v + np.cos(u))
        motif = np.clip(3 * leaf + 0.5, 0, 1)
        colour = weathered(rng, blend(light, dark, 0.85 * motif + 0.15 * noise(rng, 1.2, 8)), 0.25)
        return Texture(colour, 0.3 * motif)

    return pattern


def carpet(borders: int) -> Pattern:
    """One whole rug: bands towards a field of lozenges with a medallion."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        inset = 0.5 - np.maximum(np.abs(x - 0.5), np.abs(y - 0.5))
        third = np.array([0.12, 0.16, 0.3])
        knots = 0.5 + 0.5 * np.cos(2 * np.pi * 30 * x) * np.cos(2 * np.pi * 30 * y)
        lozenges = np.abs((13 * (x + y)) % 1 - 0.5) + np.abs((13 * (x - y)) % 1 - 0.5)
        medallion = np.cos(24 * np.hypot(x - 0.5, y - 0.5) + np.cos(8 * np.arctan2(y - 0.5, x - 0.5)))
        field = blend(dark, light, np.clip(5 * (lozenges - 0.55), 0, 1))
        field = np.where(inset[..., None] > 0.3, blend(third, light, np.clip(4 * medallion, 0, 1)), field)
        band = np.floor(inset / 0.15 * borders).astype(int)
        rim = blend(np.where((band % 2 == 0)[..., None], dark, third), light, np.clip(6 * knots - 3.6, 0, 1))
        colour = np.where(inset[..., None] < 0.15, rim, field)
        return Texture(weathered(rng, colour, 0.3), 0.6 * noise(rng, 0.8, 30))

    return pattern


def folds(count: int) -> Pattern:
    """Hanging cloth: folds that run along y, lit from one side, with a woven band."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        phase = count * x + 0.25 * (noise(rng, 2.2) - 0.5)
        fold = 0.5 + 0.5 * np.sin(2 * np.pi * phase)
        dots = np.clip(4 * np.cos(2 * np.pi * 3 * phase) * np.cos(2 * np.pi * 12 * y) - 2, 0, 1)
        colour = blend(dark, light, 0.75 * fold + 0.25 * dots)
        return Texture(weathered(rng, colour, 0.15), fold)

    return pattern


def plaid(count: int) -> Pattern:
    """Woven checks of broad and narrow threads."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        tone = np.zeros((SIZE, SIZE))
        for coordinate in grid():
            place = coordinate * count
            tone += 0.35 * (to_edge(place) < 0.22) + 0.15 * (to_edge(3 * place + 0.5) < 0.12)
        thread = 0.15 * noise(rng, 0.8, 40)
        return Texture(weathered(rng, blend(dark, light, tone + thread), 0.2), thread)

    return pattern


def landscape(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
    """A whole painting: a sky in the light colour over ranges of hills that darken towards the front."""
    y, x = grid()
    height = 1 - y
    clouds = noise(rng, 2.0, 3)
    colour = blend(light, [0.98, 0.9, 0.74], 0.7 * height + 0.5 * (clouds - 0.5))
    for i in range(4):
        ridge = 0.62 - 0.13 * i
        for k in range(1, 7):
            ridge = ridge + rng.normal(0, 0.05 / k) * np.sin(2 * np.pi * k * x + rng.uniform(0, 2 * np.pi))
        hills = blend(dark, light, 0.75 - 0.25 * i + 0.5 * (noise(rng, 1.3, 6) - 0.5))
        colour = np.where((height < ridge)[..., None], hills, colour)
    return Texture(weathered(rng, colour, 0.15), noise(rng, 0.9, 20))


def goods(rows: int, columns: int) -> Pattern:
    """A lit shop window: shelves of things in many colours."""

    def pattern(rng: np.random.Generator, dark: Array, light: Array) -> Texture:
        y, x = grid()
        row, column = np.floor(y * rows).astype(int), np.floor(x * columns).astype(int)
        hue = rng.random((rows, columns, 3))[row, column]
        tall, slim = rng.uniform(0.35, 0.85, (2, rows, columns))
        rise, side = 1 - (y * rows) % 1, np.abs((x * columns) % 1 - 0.5) * 2
        thing = (rise < tall[row, column]) & (side < slim[row, column]) & (rise > 0.08)
        wall = blend(dark, light, 0.55 + 0.45 * rise) * (rise > 0.08)[..., None]
        colour = np.where(thing[..., None], (0.25 + 0.75 * hue) * light * (1.1 - 0.5 * side**2)[..., None], wall)
        return Texture(weathered(rng, np.clip(colour, 0, 1), 0.15), thing.astype(float))

    return pattern
