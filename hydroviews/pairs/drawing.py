"""Rain of all kinds and strengths for single photographs and their companions behind the same lens.

Some of it is drawn by the data set's own generator, most by the recipes in `recipes`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.pairs.exposure import LINEAR, air_light
from hydroviews.pairs.lens_pool import WetLens
from hydroviews.pairs.photographs import Bytes
from hydroviews.pairs.raindrops import wet_lens
from hydroviews.pairs.recipes.lines import FALLING, Fall, draw_lines
from hydroviews.pairs.recipes.panes import draw_pane
from hydroviews.pairs.windows import draw_window_pane
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.rain.streaks import recipe as streaks
from hydroviews.rain.streaks.severity import BRIGHTEST, FEWEST, MOST
from hydroviews.scene.images import Image, to_uint8

FALL, LENS = ("streak", "lines"), ("window", "raindrop", "pane")  # families of falling rain, and of rain on the lens
# Shares of pairs by kind of rain: the families that the light passes, one after the other. `streak`, `window` and
# `raindrop` are the data set's own, `lines` and `pane` are other recipes, `clean` is no rain.
KINDS = {
    **{"window": 0.09, "streak+window": 0.03, "lines+window": 0.03},
    **{"raindrop": 0.12, "streak+raindrop": 0.03, "lines+raindrop": 0.03},
    **{"pane": 0.24, "streak+pane": 0.03, "lines+pane": 0.06},
    **{"streak": 0.11, "lines": 0.13, "clean": 0.1},
}
DROPS_ALONE, MIST_ALONE = 0.2, 0.15  # shares of the panes with drops or mist alone, for each to be learned apart
BRIGHTER = 0.4  # share of the streaks brighter than the recipe's 0.8, as heavy grades have them


class Pair(NamedTuple):
    """A picture in rain, and what was added to it."""

    rainy: Image  # [H, W, 3]
    clean: Image  # [H, W, 3]
    cover: NDArray[np.float32]  # [H, W, 3], by streaks, drops and mist, [0, 1]; NaN where nobody knows
    mist: NDArray[np.float32]  # [H, W, 4], V and V w, linear light; NaN where that does not say how it was put on
    companions: NDArray[np.float32]  # [K, H / 2, W / 2, 3], other pictures of the capture, in the same rain


def shares_without(*families: str, shares: Mapping[str, float] = KINDS) -> dict[str, float]:
    """Shares of the kinds of rain that are left, and add up to 1, without families and all that is made of them.

    Args:
        families: of rain, such as pane or lines.
        shares: of all kinds.

    Raises:
        InputError: no such family, or nothing is left.
    """
    unknown = set(families) - families_of(shares)
    left = {kind: share for kind, share in shares.items() if not families_of([kind]) & set(families)}
    if unknown or not left:
        found = ", ".join(sorted(unknown or families))
        raise InputError("families of rain to leave out", found=found, expected="families of rain, but not all")
    whole = sum(left.values())
    return {name: share / whole for name, share in left.items()}


def families_of(kinds: Iterable[str]) -> set[str]:
    """All families of rain that kinds of rain name."""
    return {family for kind in kinds for family in kind.split("+")}


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
        lenses: baked for the frame; at least one where the kind is `raindrop`, and one window where it is `window`.
        rng: of the pair.
        companions: [K, H / 2, W / 2, 3], any number; none if not given.

    Raises:
        ValueError: no lens of the kind.
    """
    height, width = photograph.shape[:2]
    companions = np.zeros((0, height // 2, width // 2, 3), np.uint8) if companions is None else companions
    clean, seen = photograph.astype(np.float32) / 255, companions.astype(np.float32) / 255
    pair = Pair(clean, clean, np.zeros_like(clean), np.zeros((height, width, 4), np.float32), seen)
    for family in kind.split("+"):
        if family in FALL:
            pair = behind_falling_rain(pair, family, rng)
        if family in LENS:
            pair = behind_lens(pair, family, lenses, air_light(LINEAR[photograph]), rng)
    return pair


def behind_falling_rain(pair: Pair, family: str, rng: np.random.Generator) -> Pair:
    """The pair with falling rain, of a family of FALL, in front of it.

    The mist is unknown then: dense streaks act as mist, which no plane holds.
    """
    height, width = pair.clean.shape[:2]
    fall = own_streaks(rng, width, height) if family == "streak" else draw_lines(rng, width, height)
    rainy, seen = fall.over(pair.rainy, fall.layers[0]), fall.over_all(pair.companions, rng)
    none = np.zeros_like(fall.layers[0])
    cover = np.stack([fall.layers[0], none, np.full_like(none, fall.veil)], axis=-1)
    return pair._replace(rainy=rainy, cover=cover, mist=np.full_like(pair.mist, np.nan), companions=seen)


def behind_lens(
    pair: Pair, family: str, lenses: Sequence[WetLens], air: NDArray[np.float32], rng: np.random.Generator
) -> Pair:
    """The pair with drops and mist, of a family of LENS, in front of it; `air` is linear light [3].

    Raises:
        ValueError: no lens of the family.
    """
    height, width = pair.clean.shape[:2]
    if family == "raindrop":
        lens = drawn_lens(lenses, False, rng)
        rainy, drops, mist, seen = wet_lens(to_uint8(pair.rainy), air, lens, rng, to_uint8(pair.companions))
        veil = mist[..., 0]
    elif family == "window":
        lens, alone = drawn_lens(lenses, True, rng), draw_parts(rng)
        window, half = draw_window_pane(lens, air, rng, *alone)
        rainy, seen, mist = window.over(pair.rainy), each(half.over, pair.companions), window.mist()
        drops, veil = window.mask, window.veil
    else:
        pane = draw_pane(rng, width, height, *draw_parts(rng))
        rainy, seen, mist = pane.over(pair.rainy), each(pane.half().over, pair.companions), pane.mist()
        drops, veil = pane.cover, pane.veil
    streaks, _, haze = np.moveaxis(pair.cover, -1, 0)
    cover = np.stack([streaks * (1 - drops), drops, veil + haze * (1 - veil)], axis=-1)
    return pair._replace(rainy=rainy, cover=cover, mist=pair.mist + mist, companions=seen)  # NaN where rain falls


def each(change: Callable[[Image], Image], pictures: NDArray[np.float32]) -> NDArray[np.float32]:
    """All pictures [K, H, W, 3] changed."""
    return np.stack([change(picture) for picture in pictures]) if len(pictures) else pictures


def drawn_lens(lenses: Sequence[WetLens], window: bool, rng: np.random.Generator) -> WetLens:
    """One of the lenses, a window or none.

    Raises:
        ValueError: there is no such lens.
    """
    fitting = [lens for lens in lenses if isinstance(lens.pattern, WindowPattern) == window]
    if not fitting:
        raise ValueError(f"expected a {'window' if window else 'lens with drops'} among the wet lenses")
    return fitting[rng.integers(len(fitting))]


def draw_parts(rng: np.random.Generator) -> tuple[bool, bool]:
    """Two booleans, one of them true: a pane has drops, a pane has mist."""
    chance = float(rng.uniform())
    return chance >= MIST_ALONE, chance < 1 - DROPS_ALONE


def own_streaks(rng: np.random.Generator, width: int, height: int) -> Fall:
    """The data set's streaks, of any grade."""
    pattern = draw_streaks(rng)
    layers = [streaks.streak_layer(pattern, width, height, rng) for _ in range(FALLING)]
    return Fall(np.stack(layers), lambda picture, layer: streaks.composite(picture, layer, pattern.brightness))


def draw_streaks(rng: np.random.Generator) -> streaks.StreakPattern:
    """Streaks of any grade: the paper's lengths, angles and widths, n and brightness from all that grades set."""
    drawn = streaks.draw_pattern(rng)
    n = float(rng.uniform(FEWEST, MOST))
    brighter = rng.uniform() < BRIGHTER
    brightness = float(rng.uniform(drawn.brightness, BRIGHTEST)) if brighter else drawn.brightness
    return replace(drawn, n=n, brightness=brightness)
