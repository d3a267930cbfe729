"""What is drawn for one wet lens, and from which distributions."""

from dataclasses import dataclass, replace
from typing import Literal, TypeVar, get_args

import numpy as np

from hydroviews.errors import InputError
from hydroviews.rain.scene_statistics import LensRenderer, SceneStatistics

Focus = Literal["scene", "drops"]

MEDIUM = 1  # grade
COVERAGE = ((0.05, 0.09), (0.08, 0.14), (0.12, 0.2))  # by grade
MIST = ((0.05, 0.15), (0.2, 0.3), (0.4, 0.6))
DROPLETS = ((200, 500), (400, 800), (700, 1200))
RIVULETS = ((0, 1), (1, 2), (2, 4))
TAIL = 7.0  # length of the unbroken tail of a running drop, in its radii


@dataclass(frozen=True)
class RaindropPattern:
    """A lens in rain, as it changes from the first view to the last.

    A "side" is the geometric mean of the picture's width and height.

    `coverage`, `droplets`, `rivulets`, `mist` and `focus_blur` may be changed alone: more of them adds drops and mist
    to those that are there, whose places and shapes stay (but for droplets that have less room).
    """

    coverage: float  # share of the picture that large drops cover, as far as they find room
    radius_median: float  # of the large drops, in sides
    radius_spread: float  # standard deviation of the radius's logarithm
    droplets: int  # number of tiny drops between the large ones, before those that would touch others are left out
    droplet_median: float  # of their radii, in sides
    droplet_spread: float
    rivulets: int  # drops that run down and leave trails
    contact_angle_min: float  # degrees
    contact_angle_max: float
    capillary_length: float  # 2.7 mm of glass, in sides: drops larger than this hang
    growth: float  # the most that a drop's radius grows from the first view to the last, relative
    focus_blur: float  # diameter, in sides, of the disk that the aperture makes of a point out of focus
    mist: float  # cover by mist where it is densest, 0 to 1
    air: tuple[float, float, float]  # colour of lit mist, relative to the scene's air light
    key_frames: int  # the views are shared out evenly among them, in order
    lens_renderer: LensRenderer
    seed: int  # of places, shapes and motion
    renewed: float = 0.0  # share of the drops that are new from one view to the next
    focus: Focus = "scene"  # what is sharp; the other is blurred

    @property
    def runs(self) -> tuple[float, float]:
        """Radii of running drops, and the lengths of their tails in radii."""
        return self.radius_median, TAIL

    def __post_init__(self) -> None:
        """Refuse what no lens can be.

        Raises:
            InputError: a share outside [0, 1], an unknown focus, or renewed drops that would have to be traced.
        """
        if not 0 <= self.renewed <= 1:
            raise InputError("renewed drops", found=self.renewed, expected="a share from 0 to 1 of the drops")
        if self.focus not in get_args(Focus):
            raise InputError("focus of the lens", found=self.focus, expected=" or ".join(get_args(Focus)))
        if self.renewed > 0 and self.lens_renderer == "traced":
            raise InputError(
                "renewed drops with the lens renderer traced",
                found="every view would have its own water to trace",
                expected="disk or aperture, which draw them from a bank of baked drops",
                fix="choose another --lens-renderer, or an effect without renewed drops",
            )


def draw_pattern(rng: np.random.Generator, grade: int = MEDIUM) -> RaindropPattern:
    """Draw the parameters of a lens in light, medium or heavy rain.

    Distributions, and why:

    * Radii are log-normal, the usual description of drops that come from many collisions (Marshall and Palmer's
      exponential law holds for falling drops; those on glass have lost the smallest, which merge or dry first). On
      photographs of drops on a pane in front of a camera (Qian et al. 2018), radii of 5 to 10 pixels at 720 x 480 are
      most frequent, 0.009 to 0.017 sides; condensed droplets between them are about three times smaller.
    * Contact angles of water on glass that is neither clean nor coated lie between 30 and 60 degrees.
    * A pane 5 to 15 cm in front of a camera shows 6 to 15 cm of glass: the capillary length, 2.7 mm, is 0.02 to 0.045
      sides.
    * Lenses focused on the scene draw a drop with a disk of 0.006 to 0.014 sides, as on the same photographs.
    * Coverage, mist, droplets and rivulets rise with the grade.

    Args:
        rng: the generator; the same numbers are drawn for every grade.
        grade: 0 light, 1 medium, 2 heavy.
    """
    place = rng.uniform(size=4)

    def between(limits: tuple[tuple[float, float], ...], i: int) -> float:
        low, high = limits[grade]
        return low + (high - low) * float(place[i])

    return RaindropPattern(
        coverage=between(COVERAGE, 0),
        mist=between(MIST, 1),
        droplets=round(between(DROPLETS, 2)),
        rivulets=round(between(RIVULETS, 3)),
        radius_median=float(rng.uniform(0.009, 0.017)),
        radius_spread=float(rng.uniform(0.4, 0.6)),
        droplet_median=float(rng.uniform(0.0025, 0.0045)),
        droplet_spread=float(rng.uniform(0.3, 0.5)),
        contact_angle_min=float(rng.uniform(30, 38)),
        contact_angle_max=float(rng.uniform(45, 58)),
        capillary_length=float(rng.uniform(0.02, 0.045)),
        growth=float(rng.uniform(0.02, 0.12)),
        focus_blur=float(rng.uniform(0.006, 0.014)),
        air=_tint(rng),
        key_frames=3,
        lens_renderer="disk",
        seed=int(rng.integers(2**31)),
    )


AnyPattern = TypeVar("AnyPattern", bound=RaindropPattern)


def fitted_to(drawn: AnyPattern, statistics: SceneStatistics) -> AnyPattern:
    """The lens as a scene wants it drawn; one photograph has one key frame."""
    key_frames = drawn.key_frames if len(statistics.views) > 1 else 1
    return replace(drawn, lens_renderer=statistics.lens_renderer, key_frames=key_frames)


def _tint(rng: np.random.Generator) -> tuple[float, float, float]:
    """Lit mist is a little darker or brighter than the brightest tenth of the scene, and hardly coloured."""
    strength = rng.uniform(0.85, 1.0)
    red, green, blue = (strength * (1 + 0.03 * rng.uniform(-1, 1, 3))).tolist()
    return red, green, blue
