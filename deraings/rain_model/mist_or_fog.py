"""Whether it is on the lens that things grow pale, or in the scene: told by points that several photographs show.

In linear light a point of colour b has behind mist of share V(x) on the lens, at the place x where a photograph shows
it, the colour (1 - V(x)) b + V(x) a. Fog in the scene makes it paler with its distance z, not with its place. So of the
deviations of a point's colours from their median c, to first order,

    c_v - c = (m (P(x_v) - P) + k (z_v - z)) (a - c)

with P the most mist that there may be, P and z without index their means over the photographs of the point. All points
share m, how much of the possible mist is there, and k, of fog; both are fitted by least squares in which the pixels
that are explained worst, by drops, streaks, gloss or what stands in between, do not count.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.training.images import TrainingImages
from deraings.rain_model.mist_bounds import MistBounds, mist_bounds
from deraings.rain_model.mist_config import VeilConfig
from hydroviews.scene.images import to_linear
from hydroviews.scene.point_colours import PointColours, look_up_points
from hydroviews.scene.scenes import Scene

FEWEST_VIEWS = 3  # that must show a point
FEWEST = 1000  # colours, with fewer nothing is told
KEPT = 0.8  # of the deviations count, the best explained ones
EVEN = 1e-5  # standard deviation of what mist would do, with less nothing is told
ROUNDS = 6  # of choosing them


class Paleness(NamedTuple):
    """What makes points pale."""

    mist: float  # m, how much of the possible mist is there: 1 where all of its unevenness is seen, 0 where none is
    fog: float  # k, the share of its contrast to the mist's light that a point loses over the median depth


def shows_fog(images: TrainingImages, points: Callable[[], PointColours]) -> bool:
    """Whether it is foggy in the scene that training images show; `points` is asked where it may be fog or mist."""
    config, views = VeilConfig(), range(len(images))
    bounds = mist_bounds([images.pixels(i) for i in views], config, [images.ignored(i) for i in views])
    found = paleness_of(bounds, points) if bounds.suspected else None
    return found is not None and is_fog(found, config)


def is_fog(found: Paleness, config: VeilConfig) -> bool:
    """Whether points are pale for fog; what of it may be mist on the lens is then left in the scene."""
    return found.fog >= config.foggy


def is_mist(found: Paleness, config: VeilConfig) -> bool:
    """Whether points are pale for mist on the lens, be it little."""
    return found.mist >= config.shown and not is_fog(found, config)


def paleness_of(bounds: MistBounds, points: Callable[[], PointColours]) -> Paleness | None:
    """What the points of photographs with these bounds show; see `paleness`."""
    found = points()
    places = [bounds.at(int(view), found.places[:, column]) for column, view in enumerate(found.views)]
    return paleness(found, np.stack(places, axis=1), bounds.colour)


def point_colours(scene: Scene, images: TrainingImages) -> PointColours:
    """The colours of a scene's points in its training images.

    Raises:
        InputError: a mask or depth map that cannot be read.
    """
    return look_up_points(scene, lambda view: images.pixels(view) / np.float32(255), "mist or fog")


def paleness(points: PointColours, possible: NDArray[np.float32], colour: NDArray[np.float32]) -> Paleness | None:
    """How much mist on the lens and how much fog in the scene the points show.

    Args:
        points: colours of scene points in photographs.
        possible: P [P, V], the share of mist that there may be where a photograph shows a point.
        colour: a [3], of mist in linear light.

    Returns:
        m and k, or None where too few points are seen often enough, or all at places of one P.
    """
    seen = points.seen & (points.seen.sum(axis=1) >= FEWEST_VIEWS)[:, None]
    rows = seen.any(axis=1)
    seen, possible = seen[rows], possible[rows]
    if seen.sum() < FEWEST:
        return None
    light = np.where(seen[..., None], to_linear(points.colours[rows]), np.nan).astype(np.float64)
    median = np.nanmedian(light, axis=1, keepdims=True)
    depths = points.depths[rows] / np.median(points.depths[rows][seen])
    causes = [_deviations(plane, seen)[..., None] * (colour - median) for plane in (possible, depths)]
    found, known = (light - median)[seen].ravel(), np.stack([cause[seen].ravel() for cause in causes], axis=1)
    return _trimmed_fit(known, found)


def _deviations(values: NDArray, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """From the mean of each row [P, V] over what is seen; 0 elsewhere."""
    means = np.where(seen, values, 0).sum(axis=1, keepdims=True) / seen.sum(axis=1, keepdims=True)
    return np.where(seen, values - means, 0.0)


def _trimmed_fit(known: NDArray[np.float64], found: NDArray[np.float64]) -> Paleness | None:
    """The factors of least squares found = known @ factors, over those that are explained best."""
    counted = np.ones(len(found), bool)
    factors = np.zeros(known.shape[1])
    for _ in range(ROUNDS):
        if known[counted, 0].std() < EVEN:
            return None
        factors = np.linalg.lstsq(known[counted], found[counted], rcond=None)[0]
        errors = np.abs(found - known @ factors)
        counted = errors <= np.quantile(errors, KEPT)
    return Paleness(float(factors[0]), float(factors[1]))


def may_lift(images: TrainingImages, points: Callable[[], PointColours]) -> bool:
    """Whether a smooth veil may be taken off the images: not where it is foggy in the scene, and then it is said.

    A network that sees single pictures takes fog for mist. Arguments as of `shows_fog`.
    """
    foggy = shows_fog(images, points)
    if foggy:
        print("it is foggy in the scene: the network leaves smooth veils as they are")
    return not foggy
