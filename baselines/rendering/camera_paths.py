"""Smooth closed camera paths through where a scene was photographed from, for films.

Captures that look one way get the spiral of LLFF (Mildenhall et al. 2019) and NeRF (Mildenhall et al. 2020), about the
mean camera and looking at a depth between the nearest and the farthest points. Those that look in from all around get
the ellipse of Mip-NeRF 360 (Barron et al. 2022), looking at the point that is nearest to the axes of all cameras.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points

Vectors = NDArray[np.float64]  # [..., 3]

ONE_WAY = 60.0  # degrees from the mean direction within which all cameras of a forward-facing capture look
REACH = 90  # percentile of the cameras' distances from their centre that a path reaches
TURNS = 2  # of a spiral
CLOSEST, FARTHEST = 0.1, 99.9  # percentiles of the points' depths that count as the nearest and the farthest
NEAR_BOUND, FAR_BOUND = 0.9, 5.0  # times these: the depths that LLFF's spiral looks at lie between
FAR_SHARE = 0.75  # of the far bound in the disparity that LLFF's spiral looks at
LEAST_CONVERGENCE = 1e-3  # smallest eigenvalue of the mean projector below which axes count as parallel
FINE = 4096  # steps along which an ellipse is measured


def camera_path(cameras: Sequence[Camera], points: Points, n: int) -> list[Camera]:
    """`n` cameras along a closed path, with the first camera's size and focal lengths, looking through the middle.

    Args:
        cameras: those the scene was seen by, two or more.
        points: of the scene; only needed where the cameras' axes meet nowhere in front of them.
        n: cameras along the path; the one after the last would be the first again.

    Raises:
        InputError: the point that the cameras look at is unknown.
    """
    eyes = np.array([camera.centre for camera in cameras])
    forwards = np.array([camera.rotation[2] for camera in cameras])
    up = _unit(-np.mean([camera.rotation[1] for camera in cameras], axis=0))
    if is_forward_facing(forwards):
        path, target = _spiral(eyes, forwards, up, points, n)
    else:
        target = nearest_to_axes(eyes, forwards)
        path = _ellipse(eyes, target, up, n)
    size = cameras[0]
    lens = replace(size, cx=size.width / 2, cy=size.height / 2)
    return [replace(lens, world_to_camera=look_at(eye, target, up)) for eye in path]


def is_forward_facing(forwards: Vectors) -> bool:
    """Whether all viewing directions [N, 3] lie in a cone of ONE_WAY degrees about their mean."""
    mean = forwards.mean(axis=0)
    length = np.linalg.norm(mean)
    return bool(length > 0 and (forwards @ mean).min() >= np.cos(np.radians(ONE_WAY)) * length)


def nearest_to_axes(eyes: Vectors, forwards: Vectors) -> Vectors:
    """The point [3] with the least mean squared distance from the axes of cameras at `eyes` [N, 3].

    Raises:
        InputError: the axes are parallel.
    """
    across = np.eye(3) - forwards[:, :, None] * forwards[:, None, :]
    mean = across.mean(axis=0)
    if np.linalg.eigvalsh(mean)[0] < LEAST_CONVERGENCE:
        raise InputError(
            "the point that the cameras look at is unknown",
            found="axes that are all but parallel",
            expected="cameras that look at something from several sides, or a scene with points",
        )
    return np.linalg.solve(mean, (across @ eyes[:, :, None]).mean(axis=0)[:, 0])


def look_at(eye: Vectors, target: Vectors, up: Vectors) -> NDArray[np.float64]:
    """World-to-camera [4, 4] of a camera at `eye` that has `target` in the middle and `up` upwards."""
    forward = _unit(target - eye)
    right = _unit(np.cross(forward, up))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def _spiral(eyes: Vectors, forwards: Vectors, up: Vectors, points: Points, n: int) -> tuple[Vectors, Vectors]:
    """Positions [n, 3] around the mean camera, and what they look at."""
    centre, forward = eyes.mean(axis=0), _unit(forwards.mean(axis=0))
    right = _unit(np.cross(forward, up))
    axes = np.stack([right, np.cross(forward, right), forward])
    radii = np.percentile(np.abs((eyes - centre) @ axes.T), REACH, axis=0)
    angle = 2 * np.pi * TURNS * np.arange(n) / n
    local = np.stack([np.cos(angle), -np.sin(angle), -np.sin(angle / TURNS)], axis=1) * radii
    return centre + local @ axes, centre + forward * _focus_depth(eyes, forwards, centre, forward, points)


def _focus_depth(eyes: Vectors, forwards: Vectors, centre: Vectors, forward: Vectors, points: Points) -> float:
    """How far in front of the mean camera the cameras look.

    At LLFF's disparity between the nearest and the farthest point; without points, where the cameras' axes meet.
    """
    depths = (points.positions - centre) @ forward
    depths = depths[depths > 0]
    if len(depths):
        near, far = np.percentile(depths, [CLOSEST, FARTHEST]) * (NEAR_BOUND, FAR_BOUND)
        return float(1 / ((1 - FAR_SHARE) / near + FAR_SHARE / far))
    depth = float((nearest_to_axes(eyes, forwards) - centre) @ forward)
    if depth <= 0:
        raise InputError(
            "the point that the cameras look at is unknown", found="axes that meet behind them, and no points"
        )
    return depth


def _ellipse(eyes: Vectors, target: Vectors, up: Vectors, n: int) -> Vectors:
    """Positions [n, 3] at even distances around an ellipse in the plane of the cameras, about what they look at."""
    level = eyes - (eyes @ up)[:, None] * up
    centre = target - (target @ up) * up
    offsets = level - centre
    # The two directions of the plane in which the cameras are spread most and least.
    axes = np.linalg.svd(offsets - offsets.mean(axis=0), full_matrices=False)[2][:2]
    radii = np.percentile(np.abs(offsets @ axes.T), REACH, axis=0)
    angle = 2 * np.pi * np.arange(FINE + 1) / FINE
    fine = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radii
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    even = np.linspace(0, travelled[-1], n, endpoint=False)
    around = np.stack([np.interp(even, travelled, fine[:, k]) for k in range(2)], axis=1)
    return centre + around @ axes + float((eyes @ up).mean()) * up


def _unit(vector: Vectors) -> Vectors:
    return vector / np.linalg.norm(vector)
