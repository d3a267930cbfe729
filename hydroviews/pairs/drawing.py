"""Rain of all kinds and strengths for single photographs, drawn by the data set's own generator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.pairs.photographs import LONG_SIDES, Bytes, Frame, frames
from hydroviews.rain import light
from hydroviews.rain.compositing import add_water
from hydroviews.rain.lens import pattern as drops_pattern
from hydroviews.rain.lens.bake import bake_matte, moment_of
from hydroviews.rain.lens.mist import mist_veil
from hydroviews.rain.lens.path_matte import PathMatte
from hydroviews.rain.lens.pattern import RaindropPattern
from hydroviews.rain.lens.severity import THICKEST_MIST
from hydroviews.rain.scene_statistics import AIR, TINT
from hydroviews.rain.streaks import recipe as streaks
from hydroviews.rain.streaks.severity import BRIGHTEST, FEWEST, MOST
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear, to_srgb
from hydroviews.scene.seeds import generator

FOCAL = 1.2  # focal length of a photograph in long sides: what a normal lens has
LENSES = 10  # wet lenses baked for a frame; mist, photograph, flips and crops are new in every pair
KINDS = {"streak": 0.35, "raindrop": 0.5, "both": 0.05, "clean": 0.1}  # shares of the pairs
BRIGHTER = 0.4  # share of the streaks brighter than the recipe's 0.8, as heavy grades have them
DIMMEST = 0.35  # the darkest exposure that photographs are given, in linear light
CAST = 0.1  # by how much the channels' exposures differ, at most
NO_MIST = 0.15  # share of the wet lenses without mist
OWN_MIST = 0.5  # share of the lenses with the mist of their pattern; others have another, for there to be more
COARSER = 6  # times: mist for pictures of mist alone is drawn in so much smaller
SPARSE = 4  # every so many rows and columns are looked at for the light of the air
LINEAR = to_linear(np.arange(256, dtype=np.float32) / 255)  # of 8-bit values


@dataclass(frozen=True, eq=False)
class WetLens:
    """Drops baked for a frame, and the pattern they are of."""

    pattern: RaindropPattern
    frame: int  # key frame
    matte: PathMatte


class Pair(NamedTuple):
    """A picture in rain, and what was added to it."""

    rainy: Image  # [H, W, 3]
    clean: Image  # [H, W, 3]
    cover: NDArray[np.float32]  # [H, W, 3], by streaks, drops and mist, [0, 1]; NaN where nobody knows
    mist: NDArray[np.float32]  # [H, W, 4], V and V w, linear light; NaN where streaks lie over it as well


Pool = dict[Frame, tuple[WetLens, ...]]


def camera_of(frame: Frame) -> Camera:
    """A camera for a photograph of which nothing but the size is known."""
    focal = FOCAL * max(frame)
    return Camera(*frame, focal, focal, frame[0] / 2, frame[1] / 2, np.eye(4))


def bake_pool(folder: Path, seed: int, lenses: int = LENSES, sides: Sequence[int] = LONG_SIDES) -> Pool:
    """Wet lenses of all grades, kept in `folder`; Blender bakes what is missing, 3 s each.

    Args:
        folder: where they are kept.
        seed: of their patterns.
        lenses: for every frame.
        sides: the frames' long sides, pixels.

    Raises:
        InputError: Blender failed, or a kept file is damaged.
    """
    wanted = [(frame, index) for index in range(lenses) for frame in frames(sides)]
    pool: dict[Frame, list[WetLens]] = {frame: [] for frame in frames(sides)}
    for frame, index in tqdm(wanted, desc="wet lenses", unit="lens"):
        pool[frame].append(bake_lens(folder, seed, frame, index))
    return {frame: tuple(wet) for frame, wet in pool.items()}


def bake_lens(folder: Path, seed: int, frame: Frame, index: int) -> WetLens:
    """One wet lens: grades and key frames in turn.

    Raises:
        InputError: see `bake_pool`.
    """
    rng = generator(seed, "lens", *frame, index)
    pattern = drops_pattern.draw_pattern(rng, index % len(drops_pattern.COVERAGE))
    key_frame = index % pattern.key_frames
    place = folder / f"{frame[0]}x{frame[1]}-{seed}-{index:03d}"
    return WetLens(pattern, key_frame, bake_matte(pattern, camera_of(frame), place, key_frame))


def draw_rain(photograph: Bytes, kind: str, lenses: Sequence[WetLens], rng: np.random.Generator) -> Pair:
    """A photograph in rain, and clean.

    Args:
        photograph: [H, W, 3], of a frame's size.
        kind: one of KINDS.
        lenses: baked for the frame, at least one.
        rng: of the pair.
    """
    clean = photograph.astype(np.float32) / 255
    rainy, cover, mist = clean, np.zeros_like(clean), np.zeros((*clean.shape[:2], 4), np.float32)
    if kind in ("raindrop", "both"):
        rainy, cover[..., 1], mist = wet_lens(photograph, lenses[rng.integers(len(lenses))], rng)
        cover[..., 2] = mist[..., 0]
    if kind in ("streak", "both"):
        height, width = photograph.shape[:2]
        pattern = draw_streaks(rng)
        cover[..., 0] = streaks.streak_layer(pattern, width, height, rng)
        rainy, mist = streaks.composite(rainy, cover[..., 0], pattern.brightness), np.full_like(mist, np.nan)
    return Pair(rainy, clean, cover, mist)


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


def draw_exposure(rng: np.random.Generator) -> NDArray[np.float32]:
    """Factors on linear light [3] that make of a photograph a shorter exposure in other light."""
    return np.asarray(rng.uniform(DIMMEST, 1) * rng.uniform(1 - CAST, 1, 3), np.float32)


def draw_level(rng: np.random.Generator) -> float:
    """How thick mist is at most, sometimes none."""
    return 0.0 if rng.uniform() < NO_MIST else THICKEST_MIST * float(rng.uniform()) ** 2


def wet_lens(
    photograph: Bytes, lens: WetLens, rng: np.random.Generator
) -> tuple[Image, NDArray[np.float32], NDArray[np.float32]]:
    """A photograph [H, W, 3] seen through drops and mist, its cover by drops [H, W], and the mist as in `Pair`."""
    height, width = photograph.shape[:2]
    pattern, mask = draw_mist(lens, rng), lens.matte.mask
    linear = LINEAR[photograph]
    air = air_light(linear) * np.array(pattern.air, np.float32)
    mist = mist_veil(pattern, width, height, moment_of(pattern, lens.frame))
    radiance = lens.matte.apply(light.expand_highlights(linear)) + ((1 - mask) * mist)[..., None] * air
    layers = {"M": mask, "V": mist, **{channel: radiance[..., i] for i, channel in enumerate("RGB")}}
    rainy = add_water(photograph.astype(np.float32) / 255, layers)
    return rainy, mask, with_light(mist, air)


def with_light(mist: NDArray[np.float32], air: NDArray[np.float32]) -> NDArray[np.float32]:
    """V and V w, [H, W, 4], of V [H, W] and w [3]."""
    return mist[..., None] * np.append(np.float32(1), air)


def draw_mist_alone(photograph: Bytes, rng: np.random.Generator, side: int) -> tuple[Image, Image, NDArray[np.float32]]:
    """A photograph [H, W, 3], exposed anyhow, in mist alone or none, clean, and its mist as in `Pair`.

    All are squeezed to [side, side] pixels, which costs little.
    """
    height, width = (round(length / COARSER) for length in photograph.shape[:2])
    pattern = replace(drops_pattern.draw_pattern(rng), mist=draw_level(rng))
    pattern = pattern if rng.uniform() < OWN_MIST else replace(pattern, rivulets=0)
    linear = LINEAR[cv2.resize(photograph, (side, side), interpolation=cv2.INTER_AREA)] * draw_exposure(rng)
    share = np.asarray(cv2.resize(mist_veil(pattern, width, height, float(rng.uniform())), (side, side)), np.float32)
    mist = with_light(share, air_light(linear) * np.array(pattern.air, np.float32))
    return to_srgb((1 - mist[..., :1]) * linear + mist[..., 1:]), to_srgb(linear), mist


def air_light(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """The light [3] of a scene's air, from one picture of linear light: see hydroviews.rain.scene_statistics."""
    return light.air_light(linear[::SPARSE, ::SPARSE].reshape(-1, 3), AIR, TINT)
