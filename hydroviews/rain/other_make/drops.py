"""Which drops are on a lens: what is drawn for one, and from which distributions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.other_make.refraction import Bodies
from hydroviews.scene.seeds import generator

MOST = 4000  # drops on a lens
MARGIN = 0.1  # sides beyond the picture in which drops are drawn too, so that borders cut some
SMALLEST = 0.0015  # radius in sides; smaller ones are mist
PARENTS = 60  # clusters in a picture and its margin
COVERAGE = ((0.03, 0.06), (0.06, 0.11), (0.1, 0.17))  # by grade
KEY_FRAMES = (1, 2, 5, 0)  # 0: one a view


@dataclass(frozen=True)
class LensPattern:
    """A wet lens. A side is the geometric mean of the picture's width and height."""

    coverage: float  # share of the picture under drops, as far as they do not overlap
    radius_mean: float  # in sides
    radius_shape: float  # of the gamma distribution
    clustered: float  # share of the drops that sit in clusters
    cluster_size: float  # standard deviation of a cluster, in sides
    menisci: float  # share of the drops that are puddles with a steep rim
    stretched: float  # mean of the logarithm of length over width
    hanging: float  # how far drops lean down, a unit of height
    contact_angle_min: float  # degrees
    contact_angle_max: float
    glint: float  # brightness of a drop's highlight, encoded
    glint_direction: tuple[float, float]  # of the normal, right and down, where it is brightest
    aperture_blades: int  # of the polygon that blurs drops; 0: a Gaussian
    aperture_turn: float  # radians
    focus_blur: float  # diameter of the polygon, or four standard deviations of the Gaussian, in sides
    key_frames: int  # the views are shared out among them, in order; 0: one a view
    drift: tuple[float, float]  # sides that drops move, right and down, from the first view to the last
    growth: float  # share by which their radii grow meanwhile
    mist: float  # cover by mist where it is densest
    mist_colour: tuple[float, float, float]  # encoded
    mist_coarsest: float  # waves of mist a side
    mist_finest: float
    mist_contrast: float  # standard deviation of its unevenness
    seed: int  # of places and shapes


@dataclass(frozen=True, eq=False)
class Drops:
    """Drops on a pane, places and radii in sides from the picture's centre, right and down."""

    places: NDArray[np.float64]  # [N, 2]
    radii: NDArray[np.float64]  # [N]
    bodies: Bodies


def draw_pattern(rng: np.random.Generator, level: int) -> LensPattern:
    """Draw a lens of a grade; mist is set later, by the grade.

    Radii are gamma distributed, as sizes of drops that grow by taking up neighbours are. Colours of mist lie between
    the grey-blue of a rainy sky and the warm white of street light, whatever the scene looks like.
    """
    warmth, white = rng.uniform(), rng.uniform(0.55, 0.82)
    cold, warm = np.array([0.9, 1.0, 1.1]), np.array([1.1, 1.0, 0.86])
    red, green, blue = np.clip(white * ((1 - warmth) * cold + warmth * warm), 0, 1).tolist()
    coarse = float(rng.uniform(0.5, 1.2))
    fine = bool(rng.uniform() < 0.5)
    glint, drift = rng.uniform(-2.6, -0.5), rng.uniform(0, 2 * np.pi)  # glints are above, drift is anywhere
    far = rng.uniform(0.005, 0.03)
    return LensPattern(
        coverage=float(rng.uniform(*COVERAGE[level])),
        radius_mean=float(rng.uniform(0.007, 0.013)),
        radius_shape=float(rng.uniform(1.6, 3.5)),
        clustered=float(rng.uniform(0.2, 0.6)),
        cluster_size=float(rng.uniform(0.03, 0.08)),
        menisci=float(rng.uniform(0.2, 0.5)),
        stretched=float(rng.uniform(0.05, 0.25)),
        hanging=float(rng.uniform(0.0, 0.5)),
        contact_angle_min=float(rng.uniform(25, 35)),
        contact_angle_max=float(rng.uniform(50, 70)),
        glint=float(rng.uniform(0.1, 0.5)),
        glint_direction=(float(np.cos(glint)), float(np.sin(glint))),
        aperture_blades=int(rng.choice([0, 5, 6, 7, 8])),
        aperture_turn=float(rng.uniform(0, np.pi)),
        focus_blur=float(rng.uniform(0.008, 0.02)),
        key_frames=int(rng.choice(KEY_FRAMES)),
        drift=(float(far * np.cos(drift)), float(far * np.sin(drift))),
        growth=float(rng.uniform(0.0, 0.15)),
        mist=0.0,
        mist_colour=(red, green, blue),
        mist_coarsest=coarse * (4 if fine else 1),
        mist_finest=coarse * (25 if fine else 4),
        mist_contrast=float(rng.uniform(0.15, 0.4)),
        seed=int(rng.integers(2**31)),
    )


def drops_on(pattern: LensPattern, width: int, height: int, moment: float) -> Drops:
    """The drops of a lens in front of a picture; more coverage adds drops to those that there are.

    Args:
        pattern: what is drawn.
        width: of the picture in pixels; only its shape matters.
        height: of the picture in pixels.
        moment: 0 at the first view, 1 at the last.
    """
    rng = generator(pattern.seed, "drops")
    extent = np.array([width, height]) / np.sqrt(width * height)
    reach = extent + 2 * MARGIN
    radii = np.maximum(rng.gamma(pattern.radius_shape, pattern.radius_mean / pattern.radius_shape, MOST), SMALLEST)
    parents = rng.uniform(-0.5, 0.5, (PARENTS, 2))[rng.integers(PARENTS, size=MOST)] * reach
    clustered = parents + pattern.cluster_size * rng.normal(size=(MOST, 2))
    alone = rng.uniform(-0.5, 0.5, (MOST, 2)) * reach
    places = np.where(rng.uniform(size=(MOST, 1)) < pattern.clustered, clustered, alone)
    bodies = _draw_bodies(pattern, rng)
    # Overlaps are left out of the count, as in a Boolean model: 1 - exp(-area) of the picture is covered.
    needed = -np.log1p(-min(pattern.coverage, 0.99)) * reach.prod()
    count = int(np.searchsorted(np.cumsum(np.pi * radii**2), needed))
    places += moment * np.array(pattern.drift) * rng.uniform(0.3, 1, (MOST, 1))
    radii *= 1 + moment * pattern.growth * rng.uniform(size=MOST)
    return Drops(places[:count], radii[:count], bodies.take(slice(count)))


def _draw_bodies(pattern: LensPattern, rng: np.random.Generator) -> Bodies:
    """Shapes of MOST drops: most are stretched downwards, some anyhow."""
    long = np.exp(np.minimum(rng.exponential(pattern.stretched, MOST), 0.8) / 2)[:, None, None]
    turn = np.pi / 2 + rng.normal(0, 0.5, MOST)
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    across = np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    inverse = along[:, :, None] * along[:, None] / long + across[:, :, None] * across[:, None] * long
    lean = np.stack([rng.normal(0, 0.1, MOST), pattern.hanging * rng.uniform(size=MOST)], axis=1)
    contact = np.radians(rng.uniform(pattern.contact_angle_min, pattern.contact_angle_max, MOST))
    menisci = rng.uniform(size=MOST) < pattern.menisci
    single = np.float32  # many rays go through each
    return Bodies(inverse.astype(single), lean.astype(single), contact.astype(single), menisci)
