"""Streaks as other generators draw them: lines, blurred noise, and textures of noise."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.recipes.compositing import draw_space, put_over
from hydroviews.pairs.recipes.fields import Plane, clouds, log_uniform, mean_colour, tinted
from hydroviews.scene.images import Image

FALLING = 2  # layers of streaks drawn for a capture; companions have them anywhere
STEEPEST = 70.0  # degrees that streaks lean, at most
SCREENED = 0.35  # share of the streaks put on as a screen
UNEVEN = 0.3  # share of the streaks that are denser in some places
VEILED = 0.5  # share of the streaks with a thin veil of those too far to be seen
FRACTION = 16  # parts of a pixel in which OpenCV's lines end

Draw = Callable[[np.random.Generator], Plane]


@dataclass(frozen=True, eq=False)
class Fall:
    """Streaks of one pattern, and how they are put over a picture."""

    layers: NDArray[np.float32]  # [FALLING, H, W], [0, 1]
    over: Callable[[Image, Plane], Image]
    veil: float = 0.0  # the share of all light that streaks too far to be seen block

    def over_all(self, pictures: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        """Pictures [K, H / 2, W / 2, 3], each behind one of the layers, mirrored in place anywhere."""
        if not len(pictures):
            return pictures
        height, width = pictures.shape[1:3]
        small = [np.asarray(cv2.resize(layer, (width, height), interpolation=cv2.INTER_AREA)) for layer in self.layers]
        moved = (np.roll(small[rng.integers(len(small))], rng.integers((height, width)), axis=(0, 1)) for _ in pictures)
        return np.stack([self.over(picture, layer) for picture, layer in zip(pictures, moved, strict=True)])


def draw_lines(rng: np.random.Generator, width: int, height: int) -> Fall:
    """One to three layers of streaks of several lengths, widths and brightnesses, in [height, width] pixels."""
    lean, spread = float(np.clip(rng.normal(0, 25), -STEEPEST, STEEPEST)), float(rng.uniform(0, 8))
    kinds = [_draw_kind(rng, 90 + lean, spread, width, height) for _ in range(rng.integers(1, 4))]
    space, screen = draw_space(rng), bool(rng.uniform() < SCREENED)
    bright = space.decoded(tinted(rng, float(rng.uniform(0.5, 1)), float(rng.uniform(0, 0.1))))
    of_scene = float(rng.uniform(0, 0.6)) if rng.uniform() < 0.5 else 0.0  # share of the streaks' light
    veil = float(rng.uniform(0, 0.15)) if rng.uniform() < VEILED else 0.0

    def over(picture: Image, layer: Plane) -> Image:
        scene = space.decoded(picture)
        light = bright
        if of_scene > 0:
            light = (1 - of_scene) * bright + np.float32(of_scene) * np.minimum(1.3 * mean_colour(scene), 1)
        if veil > 0:
            scene = scene + np.float32(veil) * (bright - scene)
        cover = layer[..., None]
        return space.encoded(put_over(scene, cover, cover * light, screen))

    strength = log_uniform(rng, 0.25, 1)
    layers = [strength * np.max([kind(rng) for kind in kinds], axis=0) for _ in range(FALLING)]
    density = np.clip(0.5 + 0.5 * clouds(rng, width, height, 0.25 * width), 0, 1) if rng.uniform() < UNEVEN else 1.0
    return Fall((np.stack(layers) * density).astype(np.float32), over, veil)


def _draw_kind(rng: np.random.Generator, angle: float, spread: float, width: int, height: int) -> Draw:
    """A function that draws streaks of one distance, [height, width] in [0, 1]; longer ones are wider and fewer."""
    length = log_uniform(rng, 4, 0.18 * width)
    thickness, opacity = float(rng.uniform(0.3, 0.5 + length / 40)), float(rng.uniform(0.4, 1))
    angle = float(angle + rng.normal(0, spread))
    form = str(rng.choice(("drawn", "noise", "texture")))
    if form == "drawn":
        count = int(log_uniform(rng, 0.02, 0.5) * width * height / (length * (1 + 2 * thickness)))
        return lambda rng: opacity * _drawn(rng, (count, length, angle, spread, thickness), width, height)
    kernel = _kernel(length, angle, thickness)
    if form == "noise":
        share = log_uniform(rng, 0.05, 0.8) / length / 4
        return lambda rng: opacity * _noise(rng, kernel, share, width, height)
    least, power = float(rng.uniform(0.6, 0.97)), float(rng.uniform(0.7, 2))
    return lambda rng: opacity * _texture(rng, kernel, least, power, width, height)


def _drawn(rng: np.random.Generator, streaks: tuple[int, float, float, float, float], width: int, height: int) -> Plane:
    """Single lines; count, length in pixels, angle and its spread in degrees, and thickness in pixels are given."""
    count, length, angle, spread, thickness = streaks
    middles = rng.uniform((0, 0), (width, height), (count, 2))
    turns = np.deg2rad(angle + 0.3 * spread * rng.normal(size=count))
    reaches = length / 2 * np.exp(0.4 * rng.normal(size=count))
    steps = np.column_stack([np.cos(turns), -np.sin(turns)]) * reaches[:, None]
    ends = np.rint(FRACTION * np.stack([middles - steps, middles + steps], axis=1)).astype(int).tolist()
    lines, levels = np.zeros((height, width), np.uint8), rng.uniform(60, 255, count).tolist()
    for (begin, end), level in zip(ends, levels, strict=True):
        cv2.line(lines, begin, end, (level,), max(1, round(thickness)), cv2.LINE_AA, FRACTION.bit_length() - 1)
    return np.asarray(cv2.GaussianBlur(lines.astype(np.float32) / 255, (0, 0), 0.2 + 0.5 * thickness), np.float32)


def _noise(rng: np.random.Generator, kernel: Plane, share: float, width: int, height: int) -> Plane:
    """Single pixels, a share of all, blurred along a line."""
    seeds = (rng.uniform(size=(height, width)) < share) * rng.uniform(0.3, 1, (height, width))
    return np.asarray(np.clip(cv2.filter2D(seeds.astype(np.float32), -1, kernel / kernel.max()), 0, 1), np.float32)


def _texture(rng: np.random.Generator, kernel: Plane, least: float, power: float, width: int, height: int) -> Plane:
    """Noise at every pixel blurred along a line; what is below the quantile `least` is dry."""
    texture = cv2.filter2D(rng.standard_normal((height, width), np.float32), -1, kernel, borderType=cv2.BORDER_REFLECT)
    low, high = np.quantile(texture[::3, ::3], (least, 0.998))
    return np.asarray(np.clip((texture - low) / (high - low), 0, 1) ** power, np.float32)


def _kernel(length: float, angle: float, thickness: float) -> Plane:
    """A blurred line in a square: length and thickness in pixels, angle in degrees counter-clockwise from +x."""
    side = 2 * int(length / 2 + thickness) + 3
    line = np.zeros((side, side), np.float32)
    reach = length / 2 * np.array([np.cos(np.deg2rad(angle)), -np.sin(np.deg2rad(angle))])
    middle = np.array([side // 2, side // 2])
    ends = [tuple(int(v) for v in np.rint((middle + sign * reach) * FRACTION)) for sign in (-1, 1)]
    cv2.line(line, ends[0], ends[1], (1.0,), 1, cv2.LINE_8, FRACTION.bit_length() - 1)
    return np.asarray(cv2.GaussianBlur(line, (0, 0), thickness), np.float32)
