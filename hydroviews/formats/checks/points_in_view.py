"""Cameras against points: the points of a capture are in view of its cameras."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.formats.checks.colours import are_coloured, explained
from hydroviews.formats.checks.explanations import AS_READ, Explanation, explanations
from hydroviews.formats.checks.samples import Sample, inside, places
from hydroviews.scene.scenes import Scene, View

FEW, MANY = 0.5, 0.9  # share of the points in view: a warning below the one, an explanation from the other on
FEWEST = 10  # points that tell anything


def points_in_view(scene: Scene, sample: Sample) -> list[str]:
    """A sentence where many points are in no view.

    Raises:
        InputError: not one point is in a view.
    """
    if len(sample.positions) < FEWEST:
        return []
    share = share_in_view(scene.views, sample, AS_READ)
    if share >= FEW:
        return []
    count, total = round(share * len(sample.positions)), len(sample.positions)
    said = f"{count} of {total} points are in view of a camera"
    fitting = (one.says for one in explanations() if share_in_view(scene.views, sample, one) >= MANY)
    why = explained(sample) if are_coloured(sample) else next(fitting, "")
    if share:
        return [f"{scene.name}: {said}; {why or 'do cameras and points belong together?'}"]
    raise InputError(
        f"{scene.name}: {said}",
        found=f"as it seems, {why}" if why else "cameras that look elsewhere, or points of another scene or unit",
        expected="points in front of the cameras and in their pictures",
        fix="write cameras and points in the same axes, unit and origin, or leave the points out: others are then "
        "triangulated from the photographs",
    )


def share_in_view(views: Sequence[View], sample: Sample, change: Explanation) -> float:
    """The share of the sampled points that are in front of and inside at least one view."""
    positions = change.cloud(sample.positions)
    seen: NDArray[np.bool_] = np.zeros(len(positions), bool)
    for view in views:
        left = np.flatnonzero(~seen)
        seen[left] = inside(*places(view, positions[left], change.pose(view.camera.world_to_camera)))
        if seen.all():
            break
    return float(seen.mean())
