"""Settings of one wet window pane, and the distributions they are drawn from."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hydroviews.errors import InputError
from hydroviews.rain.lens.patterns.pattern import RaindropPattern

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class WindowPattern(RaindropPattern):
    """A pane in rain, as it changes from the first view to the last; its droplets are the beads.

    Lengths are sides, angles radians, as for `RaindropPattern`. Tangents are pixels over the focal length.
    """

    kind: str  # a key of KINDS
    bead_aspect: float  # width of a bead over its height
    bead_wave: float  # amplitude of the outlines of beads, relative
    patches: float  # 0: beads lie evenly; 1: regions are free of them
    film: int  # number of vertical bands of water film
    run_radius: float  # scale of the radii of running drops
    run_tail: float  # length of the unbroken tail, in radii of the running drop
    own_light: float  # share of a drop's light that is its own; the rest is the refracted scene
    up: float  # towards the bright part of what drops show, clockwise from the top of the picture
    edge: float  # tangent, by which light has to be turned upwards to come from the bright part
    softness: float  # tangent, over which bright and dark mix
    bright: float  # light of the bright part, sRGB-encoded
    dark: float  # light of the dark part, sRGB-encoded
    uneven: float  # share of the drops' own light that is missing where the pane is darkest
    tilt: float  # diameter of the defocus disk at the far side of the pane
    tilt_direction: float  # from the near side to the far one, clockwise from the right
    mist_blur: float  # standard deviation of the scene's blur where mist hides all of it

    def __post_init__(self) -> None:
        """Refuse what no pane can be.

        Raises:
            InputError: see `RaindropPattern`; a share of own light outside [0, 1], or own light that is to be traced.
        """
        super().__post_init__()
        if not 0 <= self.own_light <= 1:
            raise InputError("own light of the drops", found=self.own_light, expected="a share from 0 to 1")
        if self.lens_renderer == "traced":
            raise InputError(
                "a window with the lens renderer traced",
                found="the light of its drops is made of baked paths",
                expected="disk or aperture",
                fix="choose another --lens-renderer",
            )

    @property
    def runs(self) -> tuple[float, float]:
        """Radii of running drops, and the lengths of their tails in radii."""
        return self.run_radius, self.run_tail


class Kind(NamedTuple):
    """Ranges of what one kind of pane is drawn from."""

    beads: Range
    aspect: Range
    patches: Range
    large: Range  # coverage by larger drops
    runs: Range
    film: Range
    mist: Range  # where it is densest, before it is set by the scene
    edge: Range
    by_drops: float  # share of the grade's harm that water is to do; the rest is mist's


# Kinds of panes in published pictures, one per line. Edges are small or negative where drops are mostly bright.
KINDS = {
    "clear": Kind((900, 1800), (0.85, 1.2), (0.0, 0.5), (0.002, 0.01), (0, 1), (0, 0), (0.0, 0.05), (-0.03, 0.08), 0.9),
    "film": Kind((800, 1300), (0.9, 1.6), (0.3, 0.8), (0.0, 0.005), (0, 1), (4, 7), (0.0, 0.1), (0.0, 0.12), 0.9),
    "misted": Kind((1400, 2400), (0.7, 1.1), (0.6, 1.0), (0.01, 0.03), (0, 2), (0, 0), (0.2, 0.4), (0.04, 0.15), 0.8),
    "flat": Kind((1200, 2200), (2.0, 2.8), (0.2, 0.8), (0.0, 0.005), (0, 0), (0, 1), (0.2, 0.4), (0.05, 0.16), 0.8),
    "fog": Kind((900, 1700), (0.8, 1.5), (0.2, 0.8), (0.01, 0.03), (3, 6), (0, 0), (0.06, 0.12), (0.08, 0.2), 0.6),
    "drenched": Kind((1500, 2600), (1.2, 2.0), (0.5, 1.0), (0.01, 0.03), (1, 3), (2, 4),
        (0.06, 0.12), (0.0, 0.12), 0.6),
}  # fmt: skip
BY_GRADE = (("clear", "film"), ("misted", "flat"), ("fog", "drenched"))
SPREADS = ((0.6, 0.75), (0.75, 0.88), (0.75, 0.88))  # of beads, by grade
TILTED = 0.25  # share of the patterns whose pane is tilted
REVERSED = 0.2  # share of the patterns whose drops are bright above


def draw_window(rng: np.random.Generator, grade: int) -> WindowPattern:
    """Draw the parameters of a pane in light, medium or heavy rain.

    Distributions, and why, measured on the published pictures (docs/rain/lens.md):

    * Radii of beads are log-normal. The median is 0.3 % of the picture's width, 0.0035 sides. The 95 % quantile is 1 to
      1.5 %, which is a spread of 0.75 to 0.88. Light panes have hardly any beads of more than 1 %: the
      same number of beads covers less. Larger drops have radii of 0.8 to 2 % of the width.
    * Contact angles are those of drops on a lens. Steeper drops turn light farther and have darker rims.
    * Drops have 0.85 to 1 of light of their own, with a soft edge between bright and dark; a tilted pane has nothing
      else. Bright and dark are 0.6 to 1 and 0.05 to 0.3, sRGB-encoded.
    * The pane is in focus: the disk is at most half a pixel at 320. A tilted pane's grows to 1.5 to 4 % of a side.
    * Mist blurs by up to 1 % of a side. Its colour is set by the scene.

    Args:
        rng: the generator.
        grade: 0 light, 1 medium, 2 heavy; each has kinds of its own.
    """
    name = str(rng.choice(BY_GRADE[grade]))
    kind = KINDS[name]
    tilted = rng.uniform() < TILTED
    reverse = rng.uniform() < REVERSED

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return WindowPattern(
        kind=name,
        coverage=between(*kind.large),
        radius_median=between(0.0105, 0.014),
        radius_spread=between(0.2, 0.3),
        droplets=round(between(*kind.beads)),
        droplet_median=between(0.0033, 0.0037),
        droplet_spread=between(*SPREADS[grade]),
        bead_aspect=between(*kind.aspect),
        bead_wave=between(0.05, 0.14),
        patches=between(*kind.patches),
        film=round(between(*kind.film)),
        rivulets=round(between(*kind.runs)),
        run_radius=between(0.004, 0.007),
        run_tail=between(40, 90),
        contact_angle_min=between(30, 38),
        contact_angle_max=between(45, 58),
        capillary_length=between(0.02, 0.045),
        growth=between(0.02, 0.12),
        focus_blur=between(0.0, 0.0015),
        mist=between(*kind.mist),
        mist_blur=between(0.004, 0.01),
        air=(1.0, 1.0, 1.0),
        own_light=1.0 if tilted else between(0.85, 1.0),
        up=between(-0.35, 0.35) + (np.pi if reverse else 0.0),
        edge=between(*kind.edge),
        softness=between(0.08, 0.2),
        bright=between(0.75, 1.0),
        dark=between(0.05, 0.3),
        uneven=between(0.1, 0.5),
        tilt=between(0.015, 0.04) if tilted else 0.0,
        tilt_direction=between(0, 2 * np.pi),
        key_frames=3,
        lens_renderer="disk",
        seed=int(rng.integers(2**31)),
    )
