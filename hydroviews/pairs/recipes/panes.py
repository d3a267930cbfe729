"""A wet pane: mist, and drops over it, that any picture of its size can be seen through."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.recipes.compositing import LINEAR, Space, draw_space
from hydroviews.pairs.recipes.drops import Drops, draw_drops
from hydroviews.pairs.recipes.fields import Plane, halved, log_uniform
from hydroviews.pairs.recipes.mist import draw_light, draw_thick_level, draw_veil, draw_wiped
from hydroviews.rain.lens.window import behind_mist
from hydroviews.scene.images import Image

WIPED = 0.5  # share of the panes whose drops have wiped mist off
BLURRING = 0.5  # share of the mists behind which the scene is less sharp


@dataclass(frozen=True, eq=False)
class Pane:
    """Mist, drops or both."""

    veil: Plane  # V [H, W], the share of the light that mist blocks
    light: NDArray[np.float32]  # w [3], of the mist, in the values of the space
    space: Space = LINEAR
    blur: float = 0.0  # standard deviation, in sides, of the scene where V is 1
    drops: Drops | None = None

    def over(self, picture: Image) -> Image:
        """The picture [H, W, 3] through the pane, both sRGB-encoded."""
        seen = self.space.decoded(picture)
        if self.veil.any():
            seen = behind_mist(seen, self.veil, self.blur)
            seen = seen + self.veil[..., None] * (self.light - seen)
        return self.space.encoded(seen if self.drops is None else self.drops.over(seen))

    @property
    def cover(self) -> Plane:
        """By drops, [H, W]."""
        return np.zeros_like(self.veil) if self.drops is None else self.drops.cover

    def mist(self) -> NDArray[np.float32]:
        """V and V w [H, W, 4], linear; NaN where mist was not added in linear light, unless there is none."""
        both = self.veil[..., None] * np.append(np.float32(1), self.light).astype(np.float32)
        return both if self.space.linear or not self.veil.any() else np.full_like(both, np.nan)

    def half(self) -> "Pane":
        """The same for pictures of half the width and height."""
        return replace(self, veil=halved(self.veil), drops=None if self.drops is None else self.drops.half())


def draw_mist(rng: np.random.Generator, width: int, height: int, level: float) -> Pane:
    """Mist alone, of any form, colour and space; `level` is V where it is densest."""
    space, blur = draw_space(rng), log_uniform(rng, 0.001, 0.012) if rng.uniform() < BLURRING else 0.0
    return Pane(draw_veil(rng, width, height, level), space.decoded(draw_light(rng)), space, blur)


def draw_pane(rng: np.random.Generator, width: int, height: int, has_drops: bool = True, has_mist: bool = True) -> Pane:
    """Mist and drops over it, or one of both alone, of so many pixels."""
    pane = draw_mist(rng, width, height, draw_thick_level(rng) if has_mist else 0.0)
    if not has_drops:
        return pane
    drops, in_focus = draw_drops(rng, width, height, pane.space)
    return replace(pane, drops=drops, veil=wiped(rng, pane.veil, in_focus))


def wiped(rng: np.random.Generator, veil: Plane, cover: Plane) -> Plane:
    """A veil [H, W] that drops with a cover [H, W] in focus have wiped off around them, or have not."""
    return veil * (1 - draw_wiped(rng, cover)) if rng.uniform() < WIPED else veil
