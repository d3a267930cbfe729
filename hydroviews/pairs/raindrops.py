"""Photographs behind the data set's own lens with drops, and mist of any level and form."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.exposure import LINEAR
from hydroviews.pairs.lens_pool import WetLens
from hydroviews.pairs.photographs import Bytes
from hydroviews.pairs.recipes.fields import halved
from hydroviews.pairs.recipes.mist import draw_level
from hydroviews.rain import light
from hydroviews.rain.compositing import water_over
from hydroviews.rain.lens.optics.bake import moment_of
from hydroviews.rain.lens.optics.path_matte import PathMatte, defocus
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.scene.images import Image, to_srgb

OWN_MIST = 0.5  # share of the lenses with the mist of their pattern; others have another, for there to be more


def draw_mist(lens: WetLens, rng: np.random.Generator) -> RaindropPattern:
    """The pattern of a lens with mist of any thickness, thin ones more often, and sometimes of another form."""
    pattern = replace(lens.pattern, mist=draw_level(rng), air=drops_pattern.draw_pattern(rng).air)
    if rng.uniform() < OWN_MIST:
        return pattern
    return replace(pattern, seed=int(rng.integers(2**31)), rivulets=0)


def wet_lens(
    photograph: Bytes, air: NDArray[np.float32], lens: WetLens, rng: np.random.Generator, companions: NDArray[np.uint8]
) -> tuple[Image, NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A photograph [H, W, 3] and its companions seen through drops and mist.

    Args:
        photograph: of the lens's size.
        air: linear light [3] of the photograph's air.
        lens: with its drops.
        rng: of the mist.
        companions: [K, H / 2, W / 2, 3].

    Returns:
        The photograph, its cover by drops [H, W], the mist as in `drawing.Pair`, the companions.
    """
    height, width = photograph.shape[:2]
    pattern, mask, linear = draw_mist(lens, rng), lens.matte.mask, LINEAR[photograph]
    air = air * np.array(pattern.air, np.float32)
    mist = mist_veil(pattern, width, height, moment_of(pattern, lens.frame))
    radiance = lens.matte.apply(light.expand_highlights(linear)) + ((1 - mask) * mist)[..., None] * air
    layers = {"M": mask, "V": mist, **{channel: radiance[..., i] for i, channel in enumerate("RGB")}}
    seen = all_behind(LINEAR[companions], lens.half, halved(mist), air) if len(companions) else companions
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
