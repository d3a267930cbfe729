"""A structure-from-motion model against itself: its points are where its keypoints are, and have the colours there."""

import numpy as np

from hydroviews.formats.checks.colours import POOR, correlation
from hydroviews.formats.checks.samples import Sample, places
from hydroviews.scene.scenes import Scene, View

FEWEST = 25  # keypoints that tell anything
SHARE, PIXELS = 0.01, 2.0  # of the longer side, and at least: by how much half of the points may miss their keypoints


def own_keypoints(scene: Scene) -> list[str]:
    """A sentence where the points do not project to the keypoints that they were made from."""
    views = [view for view in scene.views if len(_positions(scene, view)) >= FEWEST]
    missed = [_missed(scene, view) for view in views]
    if not missed:
        return []
    median = float(np.median(missed))
    side = max(views[0].camera.width, views[0].camera.height)
    if median <= max(SHARE, PIXELS / side):
        return []
    by = f"by {median * side:.0f} pixels" if np.isfinite(median) else "as they are behind the cameras"
    return [
        f"{scene.name}: the model's points miss its own keypoints {by}: are its poses camera-to-world, where COLMAP "
        "has world-to-camera, or in other axes?"
    ]


def keypoint_colours(scene: Scene, sample: Sample) -> list[str]:
    """A sentence on views whose pixels at the keypoints have other colours than the points made from them."""
    found = {}
    for view, picture in sample.pictures:
        observed = scene.observed.get(view.name)
        if observed is None or len(observed.places) < FEWEST:
            continue
        rows, columns = (np.clip(observed.places[:, ::-1], 0, 0.9999) * picture.shape[:2]).astype(int).T
        value = correlation((observed.colours / np.float32(255), picture[rows, columns]))
        if value is not None:
            found[view.name] = value
    odd = [name for name, value in found.items() if value < POOR]
    if not odd:
        return []
    which = "the photographs are" if len(odd) == len(found) else f"{', '.join(odd)}:"
    return [
        f"{scene.name}: {which} not what the model was made from: at its keypoints they have other colours than its "
        "points; other photographs of those names, turned ones, or files that were exchanged?"
    ]


def _positions(scene: Scene, view: View) -> np.ndarray:
    observed = scene.observed.get(view.name)
    return np.zeros((0, 3)) if observed is None else observed.positions


def _missed(scene: Scene, view: View) -> float:
    """The median distance of points from their keypoints, over the longer side; infinite behind the camera."""
    observed = scene.observed[view.name]
    place, depth = places(view, observed.positions)
    size = np.array([view.camera.width, view.camera.height])
    apart = np.linalg.norm((place - observed.places) * size / size.max(), axis=1)
    return float(np.median(np.where(depth > 0, apart, np.inf)))
