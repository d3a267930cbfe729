"""Rain of all kinds and strengths for single photographs and their companions behind the same lens.

Most of it is drawn by the data set's own generator, the rest by the recipes in `recipes`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs import recipes
from hydroviews.pairs.exposure import LINEAR
from hydroviews.pairs.lens_pool import WetLens
from hydroviews.pairs.photographs import Bytes
from hydroviews.rain import light
from hydroviews.rain.compositing import water_over
from hydroviews.rain.lens.optics.bake import moment_of
from hydroviews.rain.lens.optics.path_matte import PathMatte, defocus
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.lens.severity import THICKEST_MIST
from hydroviews.rain.scene_statistics import AIR, TINT
from hydroviews.rain.streaks import recipe as streaks
from hydroviews.rain.streaks.severity import BRIGHTEST, FEWEST, MOST
from hydroviews.scene.images import Image, to_srgb

KINDS = {"streak": 0.25, "raindrop": 0.45, "both": 0.05, "lines": 0.08, "pane": 0.07, "clean": 0.1}  # shares of pairs
BRIGHTER = 0.4  # share of the streaks brighter than the recipe's 0.8, as heavy grades have them
NO_MIST = 0.15  # share of the wet lenses without mist
OWN_MIST = 0.5  # share of the lenses with the mist of their pattern; others have another, for there to be more
MIST_SIZES = ((80, 53), (53, 80))  # pixels, in which mist for pictures of mist alone is drawn
SPARSE = 4  # every so many rows and columns are looked at for the light of the air


class Pair(NamedTuple):
    """A picture in rain, and what was added to it."""

    rainy: Image  # [H, W, 3]
    clean: Image  # [H, W, 3]
    cover: NDArray[np.float32]  # [H, W, 3], by streaks, drops and mist, [0, 1]; NaN where nobody knows
    mist: NDArray[np.float32]  # [H, W, 4], V and V w, linear light; NaN where that does not say how it was put on
    companions: NDArray[np.float32]  # [K, H / 2, W / 2, 3], other pictures of the capture, in the same rain


def draw_rain(
    photograph: Bytes,
    kind: str,
    lenses: Sequence[WetLens],
    rng: np.random.Generator,
    companions: NDArray[np.uint8] | None = None,
) -> Pair:
    """A photograph in rain, and clean, and its companions in the same rain.

    Args:
        photograph: [H, W, 3], of a frame's size.
        kind: one of KINDS.
        lenses: baked for the frame, at least one.
        rng: of the pair.
        companions: [K, H / 2, W / 2, 3], any number; none if not given.
    """
    height, width = photograph.shape[:2]
    companions = np.zeros((0, height // 2, width // 2, 3), np.uint8) if companions is None else companions
    clean, seen = photograph.astype(np.float32) / 255, companions.astype(np.float32) / 255
    rainy, cover, mist = clean, np.zeros_like(clean), np.zeros((height, width, 4), np.float32)
    if kind in ("raindrop", "both"):
        rainy, cover[..., 1], mist, seen = wet_lens(photograph, lenses[rng.integers(len(lenses))], rng, companions)
        cover[..., 2] = mist[..., 0]
    if kind == "pane":
        pane = recipes.draw_pane(rng, width, height, draw_level(rng))
        rainy, seen, mist = pane.over(clean), each(pane.half().over, seen), pane.mist()
        cover[..., 1], cover[..., 2] = pane.drops, pane.veil
    if kind in ("streak", "both", "lines"):
        fall = recipes.draw_lines(rng, width, height) if kind == "lines" else own_streaks(rng, width, height)
        cover[..., 0], mist = fall.layers[0], np.full_like(mist, np.nan)
        rainy, seen = fall.over(rainy, fall.layers[0]), fall.over_all(seen, rng)
    return Pair(rainy, clean, cover, mist, seen)


def each(change: Callable[[Image], Image], pictures: NDArray[np.float32]) -> NDArray[np.float32]:
    """All pictures [K, H, W, 3] changed."""
    return np.stack([change(picture) for picture in pictures]) if len(pictures) else pictures


def own_streaks(rng: np.random.Generator, width: int, height: int) -> recipes.Fall:
    """The data set's streaks, of any grade."""
    pattern = draw_streaks(rng)
    layers = [streaks.streak_layer(pattern, width, height, rng) for _ in range(recipes.FALLING)]
    return recipes.Fall(np.stack(layers), lambda picture, layer: streaks.composite(picture, layer, pattern.brightness))


def draw_streaks(rng: np.random.Generator) -> streaks.StreakPattern:
    """Streaks of any grade: the paper's lengths, angles and widths, n and brightness from all that grades set."""
    drawn = streaks.draw_pattern(rng)
    n = float(rng.uniform(FEWEST, MOST))
    brighter = rng.uniform() < BRIGHTER
    brightness = float(rng.uniform(drawn.brightness, BRIGHTEST)) if brighter else drawn.brightness
    return replace(drawn, n=n, brightness=brightness)


def draw_mist(lens: WetLens, rng: np.random.Generator) -> RaindropPattern:
    """The pattern of a lens with mist of any thickness, thin ones more often, and sometimes of another form."""
    pattern = replace(lens.pattern, mist=draw_level(rng), air=drops_pattern.draw_pattern(rng).air)
    if rng.uniform() < OWN_MIST:
        return pattern
    return replace(pattern, seed=int(rng.integers(2**31)), rivulets=0)


def draw_level(rng: np.random.Generator) -> float:
    """How thick mist is at most, sometimes none."""
    return 0.0 if rng.uniform() < NO_MIST else THICKEST_MIST * float(rng.uniform()) ** 2


def wet_lens(
    photograph: Bytes, lens: WetLens, rng: np.random.Generator, companions: NDArray[np.uint8]
) -> tuple[Image, NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A photograph [H, W, 3] and its companions seen through drops and mist.

    Returns:
        The photograph, its cover by drops [H, W], the mist as in `Pair`, the companions.
    """
    height, width = photograph.shape[:2]
    pattern, mask, linear = draw_mist(lens, rng), lens.matte.mask, LINEAR[photograph]
    air = air_light(linear) * np.array(pattern.air, np.float32)
    mist = mist_veil(pattern, width, height, moment_of(pattern, lens.frame))
    radiance = lens.matte.apply(light.expand_highlights(linear)) + ((1 - mask) * mist)[..., None] * air
    layers = {"M": mask, "V": mist, **{channel: radiance[..., i] for i, channel in enumerate("RGB")}}
    seen = all_behind(LINEAR[companions], lens.half, recipes.halved(mist), air) if len(companions) else companions
    return to_srgb(water_over(linear, layers)), mask, with_light(mist, air), seen.astype(np.float32)


def all_behind(
    linear: NDArray[np.float32], matte: PathMatte, mist: NDArray[np.float32], air: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Pictures [K, H, W, 3] of linear light behind drops and mist, sRGB-encoded, all at once: that is faster."""
    count, height, width, _ = linear.shape
    columns = np.ascontiguousarray(linear.transpose(1, 2, 0, 3)).reshape(height * width, 3 * count)
    through = np.zeros_like(columns)
    through[matte.pixels] = matte.paths @ columns
    shown = defocus(through.reshape(height, width, 3 * count), matte.disk)
    shown += matte.ambient[..., None] * columns.mean(axis=0)
    dry = (1 - matte.mask)[..., None, None]
    scene = columns.reshape(height, width, count, 3) * (1 - mist)[..., None, None] + mist[..., None, None] * air
    return to_srgb((dry * scene + shown.reshape(scene.shape)).transpose(2, 0, 1, 3))


def with_light(mist: NDArray[np.float32], air: NDArray[np.float32]) -> NDArray[np.float32]:
    """V and V w, [H, W, 4], of V [H, W] and w [3]."""
    return mist[..., None] * np.append(np.float32(1), air)


def draw_mist_alone(
    photographs: NDArray[np.uint8], rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Photographs [K, S, S, 3] of a capture in the same mist alone, or in none.

    Returns:
        Rainy, clean, and the mist [S, S, 4] as in `Pair`.
    """
    side = photographs.shape[1]
    if rng.uniform() < OWN_MIST:
        pane = own_mist(LINEAR[photographs[0]], rng, side)
    else:
        pane = recipes.draw_mist(rng, side, side, draw_level(rng))
    clean = photographs.astype(np.float32) / 255
    return each(pane.over, clean), clean, pane.mist()


def own_mist(linear: NDArray[np.float32], rng: np.random.Generator, side: int) -> recipes.Pane:
    """The data set's mist, drawn small for a photograph [S, S, 3] of linear light."""
    pattern = replace(drops_pattern.draw_pattern(rng), mist=draw_level(rng))
    pattern = pattern if rng.uniform() < OWN_MIST else replace(pattern, rivulets=0)
    shape = MIST_SIZES[int(rng.integers(len(MIST_SIZES)))]
    share = np.asarray(cv2.resize(mist_veil(pattern, *shape, float(rng.uniform())), (side, side)), np.float32)
    return recipes.Pane(share, air_light(linear) * np.array(pattern.air, np.float32))


def air_light(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """The light [3] of a scene's air, from one picture of linear light: see hydroviews.rain.scene_statistics."""
    return light.air_light(linear[::SPARSE, ::SPARSE].reshape(-1, 3), AIR, TINT)
