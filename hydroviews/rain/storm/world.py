"""Where a storm falls: which way is up in a capture, and how long a metre is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points, View

USUAL_DISTANCE = 4.0  # metres from a photographer to what is photographed, where nobody says
LEVELLING = 0.02  # weight of the mean camera's up against level horizons
SAMPLED_VIEWS = 40


def up_direction(views: Sequence[View]) -> NDArray[np.float64]:
    """The unit vector [3] against gravity, for cameras that are held level or nearly so.

    The horizontal axes of level cameras are horizontal in the world, however the cameras are tilted. So `up` is as
    perpendicular to all of them as it can be, and otherwise near to the mean of the cameras' own up: that settles
    the tilt where all cameras look the same way.
    """
    right = np.stack([view.camera.rotation[0] for view in views])
    mean = -np.mean([view.camera.rotation[1] for view in views], axis=0)
    up = np.linalg.solve(right.T @ right / len(right) + LEVELLING * np.eye(3), LEVELLING * mean)
    length = np.linalg.norm(up)
    if length < 1e-9:  # cameras on their heads beside upright ones
        raise InputError(
            "which way is up cannot be told from the cameras",
            found=f"{len(right)} cameras whose own ups cancel out",
            fix="turn the upside-down pictures and their cameras",
        )
    return up / length


def subject_distance(views: Sequence[View], points: Points) -> float | None:
    """Median distance, in scene units, from cameras to the points that they see; None where none sees any."""
    medians = []
    for view in views[:: -(-len(views) // SAMPLED_VIEWS)]:
        pixels, depth = view.camera.project(points.positions)
        size = (view.camera.width, view.camera.height)
        seen = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels <= size).all(axis=1)
        if seen.any():
            medians.append(np.median(np.linalg.norm(points.positions[seen] - view.camera.centre, axis=1)))
    return float(np.median(medians)) if medians else None


def metres_and_focus(
    views: Sequence[View], points: Points, metres_per_unit: float | None = None
) -> tuple[float, float]:
    """How many metres a unit has, and how many metres away the cameras focus.

    Without a known scale, cameras are taken to stand USUAL_DISTANCE from what they see, in the median. They focus on
    what they see, or, where that is not known, at USUAL_DISTANCE.

    Raises:
        InputError: a scale that is not positive, or none while no camera sees a point.
    """
    if metres_per_unit is not None and not 0 < metres_per_unit < np.inf:
        raise InputError("the scale of a capture", found=f"{metres_per_unit} metres a unit", expected="more than 0")
    distance = subject_distance(views, points)
    if metres_per_unit is not None:
        return metres_per_unit, USUAL_DISTANCE if distance is None else metres_per_unit * distance
    if distance is None:
        raise InputError(
            "how large the scene is cannot be told",
            found=f"{len(points)} points, none of them in a view",
            fix='say how many metres a unit has in capture.json beside the cameras: {"metres_per_unit": 0.5}',
        )
    return USUAL_DISTANCE / distance, USUAL_DISTANCE


def in_metres(camera: Camera, metres_per_unit: float) -> Camera:
    """The same camera in a world measured in metres."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] *= metres_per_unit
    return replace(camera, world_to_camera=pose)


def horizontal(first: Camera, up: NDArray, angle: float) -> NDArray[np.float64]:
    """The horizontal unit vector [3] at `angle` degrees, counter-clockwise from above, from where `first` looks."""
    ahead = first.rotation[2] - (first.rotation[2] @ up) * up
    if np.linalg.norm(ahead) < 1e-3:  # it looks straight down: the top of its picture then
        ahead = -first.rotation[1] + (first.rotation[1] @ up) * up
    ahead /= np.linalg.norm(ahead)
    turn = np.radians(angle)
    return np.asarray(np.cos(turn) * ahead + np.sin(turn) * np.cross(up, ahead))
