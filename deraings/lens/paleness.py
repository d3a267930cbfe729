"""Mist on the lens or fog in the scene: points that several photographs show tell the two apart.

In linear light a point of colour b has behind mist of alpha V(x) on the lens, at the place x where a photograph shows
it, the colour (1 - V(x)) b + V(x) a. Fog in the scene makes the point paler with its distance z, not with its place.
The deviations of a point's colours from their median c are, to first order,

    c_v - c = (m (P(x_v) - P) + k (z_v - z)) (a - c)

with P the most that V may be (`mist_bounds`), P and z without index their means over the photographs of the point. All
points share m, the share of the possible mist that is there, and k, of fog. Least squares fit both. The pixels that
are explained worst, by drops, streaks, gloss or occlusion, do not count.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.training.images import TrainingImages
from deraings.lens.mist_bounds import MistBounds, mist_bounds
from hydroviews.scene.images import to_linear
from hydroviews.scene.point_colours import PointColours, look_up_points
from hydroviews.scene.scenes import Scene

MIN_VIEWS = 3  # that must show a point
MIN_COLOURS = 1000  # in all, for a fit
KEPT = 0.8  # share of the deviations that count, the best explained ones
MIN_SPREAD = 1e-5  # standard deviation of what mist would do, for a fit
ROUNDS = 6  # of choosing the deviations that count
# Share of their contrast that points lose over the median depth, from which the scene is foggy: clean views have 0.06
# at most, fog that takes half of the light 0.3 and more.
MIN_FOG = 0.15


class Paleness(NamedTuple):
    """The causes of paleness."""

    mist: float  # m, the share of the possible mist that is there
    mist_error: float  # standard error of m
    fog: float  # k, the share of its contrast to the mist's light that a point loses over the median depth


class MistEvidence(NamedTuple):
    """Evidence of mist from the photographs of a scene and from its points."""

    bounds: MistBounds
    paleness: Paleness | None  # None where too few points are known

    @property
    def foggy(self) -> bool:
        """True if there is fog in the scene. A network that looks at single pictures takes fog for mist."""
        return self.paleness is not None and self.paleness.fog >= MIN_FOG


def mist_evidence(images: TrainingImages, points: PointColours | None = None) -> MistEvidence:
    """The evidence of photographs, and of scene points in them, if points are known."""
    views = range(len(images))
    bounds = mist_bounds([images.pixels(i) for i in views], [images.ignored(i) for i in views])
    return MistEvidence(bounds, None if points is None else paleness_of(bounds, points))


def evidence_of_scene(scene: Scene, images: TrainingImages) -> MistEvidence:
    """The evidence of a scene's training photographs, as read, and of its points; shows progress.

    Raises:
        InputError: a mask or depth map that cannot be read.
    """
    return mist_evidence(
        images, look_up_points(scene, lambda view: images.pixels(view) / np.float32(255), "mist or fog")
    )


def paleness_of(bounds: MistBounds, seen: PointColours) -> Paleness | None:
    """The paleness of points in photographs with these bounds; see `fit_paleness`."""
    columns = list(enumerate(seen.views.tolist()))
    possible = np.stack([bounds.at(view, seen.places[:, column]) for column, view in columns], axis=1)
    dry = np.stack([bounds.dry_at(view, seen.places[:, column]) for column, view in columns], axis=1)
    return fit_paleness(replace(seen, seen=seen.seen & dry), possible, bounds.colour)


def fit_paleness(points: PointColours, possible: NDArray[np.float32], colour: NDArray[np.float32]) -> Paleness | None:
    """How much mist on the lens and how much fog in the scene the points show.

    Args:
        points: colours of scene points in photographs.
        possible: P [P, V], the most that mist_alpha may be where a photograph shows a point.
        colour: a [3], of mist in linear light.

    Returns:
        m, its standard error and k, or None where too few points are seen often enough, or all at places of one P.
    """
    seen = points.seen & (points.seen.sum(axis=1) >= MIN_VIEWS)[:, None]
    rows = seen.any(axis=1)
    seen, possible = seen[rows], possible[rows]
    if seen.sum() < MIN_COLOURS:
        return None
    light = np.where(seen[..., None], to_linear(points.colours[rows]), np.nan).astype(np.float64)
    median = np.nanmedian(light, axis=1, keepdims=True)
    depths = points.depths[rows] / np.median(points.depths[rows][seen])
    causes = [_deviations(plane, seen)[..., None] * (colour - median) for plane in (possible, depths)]
    changes, known = (light - median)[seen].ravel(), np.stack([cause[seen].ravel() for cause in causes], axis=1)
    return _trimmed_fit(known, changes, len(seen))


def _deviations(values: NDArray, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """From the mean of each row [P, V] over what is seen; 0 elsewhere."""
    means = np.where(seen, values, 0).sum(axis=1, keepdims=True) / seen.sum(axis=1, keepdims=True)
    return np.where(seen, values - means, 0.0)


def _trimmed_fit(known: NDArray[np.float64], changes: NDArray[np.float64], n_points: int) -> Paleness | None:
    """The factors of least squares changes = known @ factors, over those that are explained best.

    The standard error is of as many independent deviations as there are points: the colours of one point have their
    errors in common.
    """
    counted = np.ones(len(changes), bool)
    factors = np.zeros(known.shape[1])
    for _ in range(ROUNDS):
        if known[counted, 0].std() < MIN_SPREAD:
            return None
        factors = np.linalg.lstsq(known[counted], changes[counted], rcond=None)[0]
        errors = np.abs(changes - known @ factors)
        counted = errors <= np.quantile(errors, KEPT)
    left = changes[counted] - known[counted] @ factors
    curvature = known[counted].T @ known[counted] / counted.sum()
    error = np.sqrt(left.var() * np.linalg.pinv(curvature)[0, 0] / n_points)
    return Paleness(float(factors[0]), float(error), float(factors[1]))
