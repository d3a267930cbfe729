"""Photographs behind the data set's own window panes: baked water; light, mist and tilt are new in every pair."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.lens_pool import WetLens
from hydroviews.pairs.raindrops import OWN_MIST, with_light
from hydroviews.pairs.recipes.fields import Plane, halved
from hydroviews.pairs.recipes.mist import draw_light, draw_thick_level, draw_veil
from hydroviews.pairs.recipes.panes import wiped
from hydroviews.rain.lens.optics.own_light import OwnLight, tilted
from hydroviews.rain.lens.optics.path_matte import PathMatte, dry
from hydroviews.rain.lens.patterns.window import BY_GRADE, WindowPattern, draw_window
from hydroviews.rain.lens.window import behind_mist
from hydroviews.rain.lens.window_severity import DIMMER, VEIL, faded
from hydroviews.rain.light import expand_highlights
from hydroviews.scene.images import Image, luminance, to_linear, to_srgb

RELIT = ("own_light", "bright", "dark", "uneven", "tilt", "tilt_direction", "mist_blur")  # what no matte depends on
VIVID = 0.6  # share of the panes whose drops are as bright and dark as drawn; those of the others are fainter
BY_SCENE = 0.6  # share of the mists whose light follows the scene's


@dataclass(frozen=True, eq=False)
class Window:
    """A pane in front of pictures of its size; all light is linear."""

    mask: Plane  # M [H, W], cover by drops
    lit: Image  # [H, W, 3], the drops' own light
    own: float  # share of the drops' light
    matte: PathMatte  # what else they show
    veil: Plane  # V [H, W], cover by mist
    light: NDArray[np.float32]  # w [3], of the mist
    blur: float  # standard deviation, in sides, of the scene where V is 1

    def over(self, picture: Image) -> Image:
        """The picture [H, W, 3] behind the pane, both sRGB-encoded."""
        linear = to_linear(picture)
        passing, added = self._layers
        seen = passing * behind_mist(linear, self.veil, self.blur) + added
        if self.own < 1 and self.mask.any():
            seen += (1 - self.own) * self.matte.apply(expand_highlights(linear))
        return to_srgb(seen)

    @cached_property
    def _layers(self) -> tuple[NDArray[np.float32], Image]:
        """The share of the scene's light that passes [H, W, 1], and light that is the same for all scenes."""
        dry, veil = (1 - self.mask)[..., None], self.veil[..., None]
        return dry * (1 - veil), dry * veil * self.light + self.own * self.lit

    def mist(self) -> NDArray[np.float32]:
        """V and V w, [H, W, 4]."""
        return with_light(self.veil, self.light)

    def half(self, matte: PathMatte) -> "Window":
        """The same for pictures of half the width and height, for which `matte` is."""
        return replace(self, mask=halved(self.mask), lit=halved(self.lit), veil=halved(self.veil), matte=matte)


def draw_window_pane(
    lens: WetLens, air: NDArray[np.float32], rng: np.random.Generator, has_drops: bool = True, has_mist: bool = True
) -> tuple[Window, Window]:
    """A baked pane in new light and new mist, or with drops or mist alone; and the same for half the size.

    Args:
        lens: whose pattern is a window's.
        air: linear light [3] of the scene's air.
        rng: the generator.
        has_drops: whether there are drops.
        has_mist: whether there is mist.

    Raises:
        ValueError: the lens is no window.
    """
    matte = lens.matte
    height, width = matte.mask.shape
    if matte.sky is None or not isinstance(lens.pattern, WindowPattern):
        raise ValueError("expected a window")
    pattern = draw_lighting(lens.pattern, rng)
    level = draw_thick_level(rng) if has_mist else 0.0
    if not has_drops:
        veil = draw_veil(rng, width, height, level)
    elif rng.uniform() < OWN_MIST:
        veil = np.float32(level) * lens.window_form
    else:
        veil = wiped(rng, draw_veil(rng, width, height, level), matte.mask)
    light = draw_veil_light(air, rng)
    half = lens.half
    mask, lit = matte.mask, np.zeros((height, width, 3), np.float32)
    if has_drops:
        mask, lit = tilted([mask, OwnLight(pattern, width, height).radiance(mask, matte.sky)], pattern)
    else:
        matte, half = dry(height, width, window=True), dry(height // 2, width // 2, window=True)
        mask = matte.mask
    window = Window(np.clip(mask, 0, 1), lit, pattern.own_light, matte, veil, light, pattern.mist_blur)
    return window, window.half(half)


def draw_lighting(pattern: WindowPattern, rng: np.random.Generator) -> WindowPattern:
    """The pattern with new light of its drops, tilt and blur, as patterns of any grade have them."""
    new = draw_window(rng, int(rng.integers(len(BY_GRADE))))
    new = replace(pattern, **{name: getattr(new, name) for name in RELIT}, seed=new.seed)
    vivid = 1.0 if rng.uniform() < VIVID else float(rng.uniform())
    bright, dark = faded(new, vivid)
    return replace(new, bright=bright, dark=dark)


def draw_veil_light(air: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Linear light [3] of mist: a grey about as bright as the air, or any."""
    if rng.uniform() > BY_SCENE:
        return to_linear(draw_light(rng))
    encoded = float(to_srgb(luminance(air[None]))[0] * rng.uniform(*DIMMER))
    tint = 1 + 0.02 * rng.uniform(-1, 1, 3)
    return to_linear(np.clip(np.clip(encoded, *VEIL) * tint, 0, 1))
