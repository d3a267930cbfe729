"""Cameras against each other: a scene is seen from several places."""

import numpy as np

from hydroviews.formats.checks.samples import Sample
from hydroviews.scene.scenes import Scene

NEAR = 1e-4  # of the distance to the points, within which all cameras are at one place
SAME = 1e-6  # of their distance from the origin, where there are no points


def camera_positions(scene: Scene, sample: Sample) -> list[str]:
    """A sentence where all cameras are at one place."""
    centres = np.stack([view.camera.centre for view in scene.views])
    spread = float(np.linalg.norm(centres - centres[0], axis=1).max())
    if len(sample.positions):
        limit = NEAR * float(np.median(np.linalg.norm(sample.positions - centres[0], axis=1)))
    else:
        limit = SAME * (1 + float(np.abs(centres[0]).max()))
    if len(centres) < 2 or spread > limit:
        return []
    why = "nothing can be learned of depth: a tracker that stood still, or poses that were never filled in?"
    return [f"{scene.name}: all {len(centres)} cameras are at one place; {why}"]
