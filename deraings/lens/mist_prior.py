"""The mist that is to be expected on the lens before any training, and how surely: a Gaussian per knot.

Three sources say how large mist_alpha is at a place of the lens. Each has a mean and a standard deviation, and their
mean is weighed by the inverse variances:

* the photographs' bound: anything from no mist to the possible mist P is as likely, so P / 2 with P / sqrt(12);
* the network, the mean over photographs, of which the deviation from photograph to photograph is known;
* scene points: m P with the error of m (`paleness`). In fog, points of all depths grow pale, and m is known less.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.lens.mist_bounds import MistBounds
from deraings.lens.paleness import MistEvidence
from deraings.lens.time_knots import views_near

# Errors that photographs of one capture share, measured on development scenes: of the network as a share of its mean
# and as mist_alpha, and of m in dry views.
NETWORK_SHARE, NETWORK_LEAST = 0.3, 0.003
POINTS_ERROR = 0.5
LEAST = 1e-4  # mist_alpha; no source is surer than that
# From which there is mist. Predicted mist_alpha of development scenes: dry 0.0007 at most, streaks 0.0022, heavy ones
# 0.0036, medium windows 0.0032 and more. Share m of the possible mist: dry 0.09, streaks 0.28, heavy ones 0.51 at most.
LEAST_PREDICTED, LEAST_SHARE = 0.003, 0.5


class NetworkMist(NamedTuple):
    """The mist that a network predicts on the lens of a view."""

    light: NDArray[np.float32]  # [16, 16], linear light that the mist adds
    error: NDArray[np.float32]  # [16, 16], standard error of the mean over photographs


class MistPrior(NamedTuple):
    """A Gaussian per knot [T, h, w] of mist_alpha, where there is mist at all."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    evidence: MistEvidence  # what it is made of, beside the network
    predicted: float  # the median over the lens that a network predicts of mist_alpha; NaN where none does
    removed: NDArray[np.float32]  # the most that the network takes away of mist_alpha; 0 where it predicts none


def mist_prior(evidence: MistEvidence, network: Callable[[int], NetworkMist | None]) -> MistPrior:
    """The prior from all sources that there are.

    Args:
        evidence: what photographs and scene points show.
        network: what a network predicts for the lens of a view; None where it predicts nothing.
    """
    bounds, paleness = evidence
    possible = bounds.possible
    sources = [(possible / 2, possible / np.sqrt(12))]
    if paleness is not None:
        error = np.sqrt(paleness.mist_error**2 + POINTS_ERROR**2 + paleness.fog**2)
        sources.append((max(paleness.mist, 0.0) * possible, error * possible))
    predicted = [_of_knot(bounds, network, knot) for knot in range(len(possible))]
    known = [source for source in predicted if source is not None]
    if len(known) == len(possible):
        sources.append((np.stack([mean for mean, _ in known]), np.stack([deviation for _, deviation in known])))
    mean, deviation = weighed_mean(sources)
    light = float(np.median([mean for mean, _ in known])) if known else float("nan")
    removed = np.stack(
        [np.zeros_like(possible[0]) if source is None else source[0] + source[1] for source in predicted]
    )
    return MistPrior(np.minimum(mean, bounds.max_alpha), deviation, evidence, light, removed)


def mist_exists(prior: MistPrior, wet: bool) -> bool:
    """Whether there is mist on the lens, be it little: a wet lens or a network shows it, without a network points do.

    Even mist changes no prediction of one view by others: no trial can tell it from none, so that sources have to. A
    network takes fog in the scene for mist; points tell them apart.

    Args:
        prior: of the mist that there would be.
        wet: whether there are drops on the lens.
    """
    paleness = prior.evidence.paleness
    if prior.evidence.foggy:
        return False
    if np.isnan(prior.predicted):
        return paleness is None or paleness.mist >= LEAST_SHARE
    return wet or prior.predicted >= LEAST_PREDICTED


def weighed_mean(sources: Sequence[tuple[NDArray, NDArray]]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mean and standard deviation of the product of Gaussians, given as means and deviations of one shape."""
    precisions = [1 / np.maximum(deviation, LEAST) ** 2 for _, deviation in sources]
    total = np.sum(precisions, axis=0)
    mean = np.sum([precision * mean for precision, (mean, _) in zip(precisions, sources, strict=True)], axis=0) / total
    return mean.astype(np.float32), (1 / np.sqrt(total)).astype(np.float32)


def _of_knot(
    bounds: MistBounds, network: Callable[[int], NetworkMist | None], knot: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Mean and deviation [h, w] of mist_alpha about the time of a knot, as a network predicts them, if it does."""
    times, height, width = bounds.possible.shape
    near = [mist for view in views_near(knot, bounds.n_views, times) if (mist := network(view)) is not None]
    if not near:
        return None
    light, error = (np.mean([getattr(mist, name) for mist in near], axis=0) for name in NetworkMist._fields)
    mean, spread = (np.maximum(_at_knots(plane / bounds.colour.mean(), (height, width)), 0) for plane in (light, error))
    return mean, np.sqrt(spread**2 + (NETWORK_SHARE * mean) ** 2 + NETWORK_LEAST**2)


def _at_knots(plane: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Values of cells [h, w] at knots, the outermost of which lie on the edges of the lens."""
    height, width = plane.shape
    down, across = (np.linspace(0, side, knots) - 0.5 for side, knots in zip((height, width), size, strict=True))
    places = np.meshgrid(across.astype(np.float32), down.astype(np.float32))
    values = np.asarray(plane, np.float32)
    return np.asarray(cv2.remap(values, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
