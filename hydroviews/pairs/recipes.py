"""Rain by other recipes than the data set's, so that networks learn what recipes have in common.

Lines and layers of blurred noise, as collections of synthetic rain draw their streaks; and a wet pane: mist of any form
and colour over drops that show a shrunk, mirrored and blurred piece of the picture. Light is added in linear light or
in encoded values, by chance. All ranges are wide: none is fitted to any data set.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import Image, to_linear, to_srgb

FALLING = 2  # layers of streaks drawn for a capture; companions have them anywhere
Plane = NDArray[np.float32]  # [H, W]


@dataclass(frozen=True, eq=False)
class Fall:
    """Streaks of one pattern, and how they are put over a picture."""

    layers: NDArray[np.float32]  # [FALLING, H, W], [0, 1]
    over: Callable[[Image, Plane], Image]

    def over_all(self, pictures: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        """Pictures [K, H / 2, W / 2, 3], each behind one of the layers, mirrored in place anywhere."""
        if not len(pictures):
            return pictures
        height, width = pictures.shape[1:3]
        small = [np.asarray(cv2.resize(layer, (width, height), interpolation=cv2.INTER_AREA)) for layer in self.layers]
        moved = (np.roll(small[rng.integers(len(small))], rng.integers((height, width)), axis=(0, 1)) for _ in pictures)
        return np.stack([self.over(picture, layer) for picture, layer in zip(pictures, moved, strict=True)])


@dataclass(frozen=True, eq=False)
class Pane:
    """Mist and drops that any picture of its size can be seen through."""

    veil: Plane  # V [H, W], the share of the light that mist blocks
    light: NDArray[np.float32]  # [3], of the mist: linear, or encoded where that is how it is added
    linear: bool = True
    drops: Plane | None = None  # cover [H, W]
    source: NDArray[np.float32] | None = None  # [H, W, 2], the column and row that a drop shows at each pixel
    blur: float = 0.0  # standard deviation, in pixels, of what drops show
    gain: float = 1.0  # of the light of what they show

    def over(self, picture: Image) -> Image:
        """The picture [H, W, 3] through the pane."""
        scene = to_linear(picture) if self.linear else picture
        veil = self.veil[..., None]
        seen = (1 - veil) * scene + veil * self.light
        if self.drops is not None and self.source is not None:
            blurred = cv2.GaussianBlur(scene, (0, 0), self.blur)
            columns, rows = cv2.split(self.source)
            shown = cv2.remap(blurred, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
            seen += self.drops[..., None] * (self.gain * shown - seen)
        seen = np.clip(seen, 0, 1).astype(np.float32)
        return to_srgb(seen) if self.linear else seen

    def mist(self) -> NDArray[np.float32]:
        """V and V w [H, W, 4], linear; NaN where mist was added in encoded values, unless there is none."""
        both = self.veil[..., None] * np.append(np.float32(1), self.light).astype(np.float32)
        return both if self.linear or not self.veil.any() else np.full_like(both, np.nan)

    def half(self) -> "Pane":
        """The same for pictures of half the width and height."""
        small = replace(self, veil=halved(self.veil), blur=self.blur / 2)
        if self.drops is None or self.source is None:
            return small
        return replace(small, drops=halved(self.drops), source=halved(self.source) / 2)


def draw_mist(rng: np.random.Generator, width: int, height: int, level: float) -> Pane:
    """Mist of any unevenness, coarse or fine, whose light has any colour cast; `level` is V where it is densest."""
    form = np.zeros((height, width), np.float32)
    for _ in range(rng.integers(1, 4)):
        sigma = float(np.exp(rng.uniform(np.log(0.03), np.log(0.5)))) * np.sqrt(width * height)
        form += float(rng.uniform(0.2, 1)) * _clouds(rng, width, height, sigma)
    y, x = np.mgrid[-0.5 : 0.5 : height * 1j, -0.5 : 0.5 : width * 1j].astype(np.float32)
    slope = rng.normal(0, 1, 2).astype(np.float32)
    form += slope[0] * x + slope[1] * y
    low, high = np.quantile(form, (rng.uniform(0, 0.3), rng.uniform(0.7, 1)))
    least = float(rng.uniform(0, 0.8))
    veil = level * (least + (1 - least) * np.clip((form - low) / max(high - low, 1e-6), 0, 1))
    light = rng.uniform(0.35, 1) * (1 + rng.uniform(0, 0.2) * rng.uniform(-1, 1, 3))
    return Pane(veil.astype(np.float32), np.clip(light, 0, 1).astype(np.float32), bool(rng.uniform() < 0.5))


def draw_pane(rng: np.random.Generator, width: int, height: int, level: float) -> Pane:
    """Mist, and drops that show what is around them upside down, defocused or sharp."""
    pane, side = draw_mist(rng, width, height, level), float(np.sqrt(width * height))
    cover = np.zeros((height, width), np.float32)
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    source = np.stack([columns, rows], axis=-1)
    wanted, typical = rng.uniform(0.02, 0.2) * width * height, np.exp(rng.uniform(np.log(0.006), np.log(0.03))) * side
    shrink, most = rng.uniform(2, 8), rng.uniform(0.7, 1)
    area = 0.0
    while area < wanted:
        radius = float(np.clip(typical * np.exp(rng.normal(0, 0.5)), 1, 0.1 * side))
        middle, stretch = rng.uniform((0, 0), (width, height)), float(rng.uniform(0.8, 1.4))
        reach = int(radius * stretch) + 1
        top, left = max(int(middle[1]) - reach, 0), max(int(middle[0]) - reach, 0)
        here = np.s_[top : int(middle[1]) + reach + 1, left : int(middle[0]) + reach + 1]
        dx, dy = columns[here] - middle[0], rows[here] - middle[1]
        inside = np.hypot(dx, dy / stretch) < radius
        cover[here][inside] = most
        source[here][inside] = np.stack([middle[0] - shrink * dx, middle[1] - shrink * dy], axis=-1)[inside]
        area += np.pi * radius**2 * stretch
    soft = cv2.GaussianBlur(cover, (0, 0), float(np.exp(rng.uniform(np.log(0.4), np.log(4)))))
    return replace(
        pane,
        drops=np.asarray(soft, np.float32),
        source=source,
        blur=float(rng.uniform(0.5, 4)),
        gain=float(rng.uniform(0.8, 1.2)),
    )


def draw_lines(rng: np.random.Generator, width: int, height: int) -> Fall:
    """Lines, or blurred noise in layers, of several lengths, widths and brightnesses, under a thin veil."""
    angle, spread = rng.uniform(45, 135), rng.uniform(0, 8)
    kinds = [_Layer.draw(rng, angle, spread, width) for _ in range(rng.integers(1, 4))]
    brightness, strength = float(rng.uniform(0.6, 1)), float(rng.uniform(0.3, 1))
    veil, screen, linear = float(rng.uniform(0, 0.1)), bool(rng.uniform() < 0.5), bool(rng.uniform() < 0.2)

    def over(picture: Image, layer: Plane) -> Image:
        scene = to_linear(picture) if linear else picture
        scene = (1 - veil) * scene + np.float32(veil * brightness)
        cover = layer[..., None]
        mixed = 1 - (1 - scene) * (1 - brightness * cover) if screen else scene + cover * (brightness - scene)
        mixed = np.clip(mixed, 0, 1).astype(np.float32)
        return to_srgb(mixed) if linear else mixed

    layers = [strength * np.max([kind.drawn(rng, width, height) for kind in kinds], axis=0) for _ in range(FALLING)]
    return Fall(np.stack(layers).astype(np.float32), over)


@dataclass(frozen=True)
class _Layer:
    """Streaks of one distance: sparse points or dense noise, blurred along a line."""

    angle: float  # degrees counter-clockwise from +x
    length: float  # pixels
    width: float  # standard deviation across, pixels
    share: float  # of the pixels that a streak starts from
    opacity: float

    @classmethod
    def draw(cls, rng: np.random.Generator, angle: float, spread: float, width: int) -> "_Layer":
        """Longer ones are nearer: wider and fewer."""
        length = float(np.exp(rng.uniform(np.log(4), np.log(0.15 * width))))
        share = float(np.exp(rng.uniform(np.log(0.05), np.log(0.8)))) / length / 4
        thickness = float(rng.uniform(0.3, 0.4 + length / 40))
        return cls(float(angle + rng.normal(0, spread)), length, thickness, share, float(rng.uniform(0.4, 1)))

    def drawn(self, rng: np.random.Generator, width: int, height: int) -> Plane:
        """[H, W] in [0, opacity]."""
        seeds = (rng.uniform(size=(height, width)) < self.share) * rng.uniform(0.3, 1, (height, width))
        side = 2 * int(self.length / 2) + 3
        line = np.zeros((side, side), np.float32)
        reach = self.length / 2 * np.array([np.cos(np.deg2rad(self.angle)), -np.sin(np.deg2rad(self.angle))])
        middle, fixed = np.array([side // 2, side // 2]), 16  # OpenCV's lines may end between pixels
        ends = [tuple(int(v) for v in np.rint((middle + sign * reach) * fixed)) for sign in (-1, 1)]
        cv2.line(line, ends[0], ends[1], (1.0,), 1, cv2.LINE_8, 4)
        blurred = cv2.GaussianBlur(line, (0, 0), self.width)
        streaks = cv2.filter2D(seeds.astype(np.float32), -1, blurred / blurred.max())
        return np.asarray(self.opacity * np.clip(streaks, 0, 1), np.float32)


def compressed(picture: Image, quality: int) -> Image:
    """A picture [H, W, 3] after JPEG of a quality from 1 to 100."""
    pixels = np.rint(255 * picture[..., ::-1]).astype(np.uint8)
    _, stored = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    read = cast(NDArray[np.uint8], cv2.imdecode(stored, cv2.IMREAD_COLOR))
    return np.ascontiguousarray(read[..., ::-1], np.float32) / 255


def _clouds(rng: np.random.Generator, width: int, height: int, sigma: float) -> Plane:
    """Smooth noise of unit spread, drawn coarsely: [H, W]."""
    cell = max(1.0, sigma / 2)
    rows, columns = (int(np.ceil(length / cell)) + 3 for length in (height, width))
    coarse = cv2.GaussianBlur(rng.normal(size=(rows, columns)).astype(np.float32), (0, 0), sigma / cell)
    fine = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray((fine - fine.mean()) / max(float(fine.std()), 1e-6), np.float32)


def halved(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Averages of 2x2 pixels, of [H, W] or [H, W, C]."""
    height, width = plane.shape[:2]
    return np.asarray(cv2.resize(plane, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.float32)
