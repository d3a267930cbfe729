"""How many beads and how much mist a grade needs on a window, and what colour the mist has.

Drops of a pane show mostly light of their own, so they differ from the scene alike in every view. Each place of the
scene is behind a bead in a share m of the views. The L1 loss passes over few beads as outliers. Many beads are learned
as a veil of their mean light, about as m squared over the number of views that see a place. The rest differs from view
to view, and falls with the number of views faster than the error of a mean. Mist stays in place and is learned as part
of the scene.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.optics.own_light import GLARE
from hydroviews.rain.lens.patterns.bodies import bodies_of
from hydroviews.rain.lens.patterns.mist import window_mist
from hydroviews.rain.lens.patterns.water import water_at
from hydroviews.rain.lens.patterns.window import KINDS, WindowPattern
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.severity import solve, wanted_harm
from hydroviews.scene.images import Image, luminance, to_linear, to_srgb

LOSS = {"light": 1.4, "medium": 4.1, "heavy": 8.5}  # dB that plain 3DGS is to lose
LEARNED = 22.0  # veil of the drops' mean light that is learned, over cover squared times inverse visibility; measured
SMEARED = 1.3  # the same of drops out of focus, which are no outliers, over that of drops in focus; measured
NOISE = 3.5  # of what differs from view to view, over its variance times inverse visibility to the power 1.5; measured
RAREST = 0.15  # mean inverse visibility that counts at most: what hardly any view shows is hardly judged either
MOST_MIST = {"light": 0.25, "medium": 0.7, "heavy": 0.95}
BEADS = (800, 4000)
FAINT = (0.6, 0.3)  # the least light of the bright part, the most of the dark one, sRGB-encoded
VEIL = (0.44, 0.93)  # of published pictures, sRGB-encoded: grey indoors, nearly white outdoors
DIMMER = (0.85, 1.4)  # of the veil over the scene's brightest tenth, sRGB-encoded
TURN = 0.4  # tangent by which a drop turns light at its rim, about
AVERAGED = 0.04  # sides over which the cover by single drops averages out among views


def lit_by(drawn: WindowPattern, rng: np.random.Generator, statistics: SceneStatistics) -> WindowPattern:
    """The pattern with mist as bright as a little less than the brightest tenth of the scene, within VEIL."""
    air = np.array(statistics.light.air, np.float32)
    encoded = to_srgb(luminance(air[None]))[0] * rng.uniform(*DIMMER)
    veil = to_linear(np.clip(encoded, *VEIL).astype(np.float32)[None])[0]
    tint = 1 + 0.02 * rng.uniform(-1, 1, 3)
    red, green, blue = (float(value) for value in veil * tint / np.maximum(air, 1e-3))
    return replace(drawn, air=(red, green, blue))


def grade_window(drawn: WindowPattern, grade: str, statistics: SceneStatistics) -> WindowPattern:
    """The pattern with as many beads, and then as much mist, as cost plain 3DGS what the grade says on this scene.

    If the fewest beads are too many, they have fainter light, and there are fewer bands of film. The heavy grade has
    no upper end: heavy panes have at least the beads and the mist that were drawn, as published ones have.
    """
    heavy = grade == "heavy"
    wanted = wanted_harm(LOSS[grade], statistics)
    by_drops = KINDS[drawn.kind].by_drops * wanted
    fewest, most = (count / drawn.droplets for count in BEADS)
    fewest = 1.0 if heavy else fewest
    harm = WindowHarm(drawn, statistics)
    while drawn.film > 0 and not heavy and harm(fewest, 0.0, 0.0) > by_drops:
        drawn = replace(drawn, film=drawn.film - 1)
        harm = WindowHarm(drawn, statistics)
    beads = solve(lambda share: harm(share, 0.0), by_drops, fewest, min(most, 1.0))
    vivid = 1.0 if heavy else solve(lambda share: harm(beads, 0.0, share), by_drops, 0.0, 1.0)
    mist = solve(lambda level: harm(beads, level, vivid), wanted, drawn.mist if heavy else 0.0, MOST_MIST[grade])
    if harm(beads, mist, vivid) < wanted:
        beads = solve(lambda share: harm(share, mist, vivid), wanted, beads, max(most, beads))
    bright, dark = (round(value, 4) for value in faded(drawn, vivid))
    return replace(drawn, droplets=round(beads * drawn.droplets), mist=round(mist, 4), bright=bright, dark=dark)


class WindowHarm:
    """For beads as a share of those drawn, and mist, the mean squared error that a pane leaves in what is learned."""

    def __init__(self, pattern: WindowPattern, statistics: SceneStatistics) -> None:
        air = (np.array(pattern.air) * statistics.light.air).astype(np.float32)
        self._air, self._blur = air, pattern.mist_blur
        rarity = min(statistics.mean_inverse_visibility, RAREST)
        self._noise = NOISE * statistics.drops_cost * rarity**1.5
        self._pattern = pattern
        self._learned = LEARNED * rarity * (SMEARED if pattern.tilt > 0 else 1.0)
        self._scenes = [(sample, to_linear(sample)) for sample in statistics.samples]
        form = replace(pattern, mist=1.0)
        shapes = {(sample.shape[0], sample.shape[1]) for sample in statistics.samples}
        self._forms = {(h, w): window_mist(form, w, h, moment=0.5)[..., None] for h, w in shapes}
        self._covers = {shape: cover_by_water(pattern, shape) for shape in shapes}

    def __call__(self, beads: float, mist: float, vivid: float = 1.0) -> float:
        """In encoded values; `vivid` is as for `faded`."""
        light = drops_light(self._pattern, vivid)
        return float(np.mean([self._of(sample, linear, beads, mist, light) for sample, linear in self._scenes]))

    def _of(self, sample: Image, linear: Image, beads: float, mist: float, light: tuple[float, float, float]) -> float:
        small, rest = self._covers[sample.shape[0], sample.shape[1]]
        cover = np.minimum(beads * small + rest, 0.9)[..., None]
        veil = mist * self._forms[sample.shape[0], sample.shape[1]]
        sky, bright, dark = light
        misty = (1 - veil) * linear + veil * self._air
        veiled = np.minimum(self._learned * cover, 1) * cover
        learned = to_srgb((1 - veiled) * misty + veiled * (sky * bright + (1 - sky) * dark))
        seen = to_srgb(misty)
        shown = [(share, float(to_srgb(np.array([v], np.float32))[0])) for share, v in ((sky, bright), (1 - sky, dark))]
        off = sum(share * (value - seen) ** 2 for share, value in shown)
        return float(np.mean((learned - sample) ** 2) + self._noise * np.mean(cover * (1 - cover) * off))


def faded(pattern: WindowPattern, vivid: float) -> tuple[float, float]:
    """The bright and the dark part of drops, sRGB-encoded: as drawn if `vivid` is 1, and FAINT if it is 0."""
    bright, dark = (
        faint + vivid * (own - faint) for own, faint in zip((pattern.bright, pattern.dark), FAINT, strict=True)
    )
    return bright, dark


def drops_light(pattern: WindowPattern, vivid: float) -> tuple[float, float, float]:
    """The share of drops' light that is bright, and linear light of the bright and the dark part, in the mean.

    A drop turns light by about TURN times the distance from its middle over its radius, and its bright part is a
    segment of its disk.
    """
    t = float(np.clip(pattern.edge / TURN, -1, 1))
    sky = float((np.arccos(t) - t * np.sqrt(1 - t * t)) / np.pi)
    bright, dark = (float(v) for v in to_linear(np.array(faded(pattern, vivid), np.float32)))
    dim = 1 - pattern.uneven / 2
    return sky, dim * bright * (GLARE if pattern.tilt > 0 else 1.0), dim * dark


def cover_by_water(pattern: WindowPattern, shape: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cover [H, W] of a picture by beads, and by all other water, averaged over AVERAGED sides."""
    height, width = shape
    side = float(np.sqrt(height * width))
    extent = (width / side, height / side)
    every, others = (
        _averaged(bodies_of(water_at(some, extent, moment=0.5)).disks, shape, side)
        for some in (pattern, replace(pattern, droplets=0))
    )
    return np.maximum(every - others, 0), others


def _averaged(disks: NDArray[np.float64], shape: tuple[int, int], side: float) -> NDArray[np.float32]:
    edges = [np.arange(0, length + 1) for length in shape]
    area = np.pi * (disks[:, 2] * side) ** 2
    found, *_ = np.histogram2d(disks[:, 1] * side, disks[:, 0] * side, edges, weights=area)
    return np.asarray(cv2.GaussianBlur(found.astype(np.float32), (0, 0), AVERAGED * side), np.float32)
