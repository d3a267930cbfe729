"""Gaussians for the sky (WildGaussians, Kulhanek et al. 2024, section 3.4): points on a sphere far behind the scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.initialisation import FEWEST_POINTS, scene_extent
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points, Scene

QUANTILE = 0.97  # of the points' distances from their mean: the scene's radius
DISTANCE = 10.0  # of the sky, in radii
UPPER = 2 / 3  # of the picture: only there is sky looked for
LARGEST = 3.0  # times the distance between two sky points: larger Gaussians are removed
PALE = np.array([225, 235, 245], np.uint8)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Where the scene is, without the few points that lie far off."""

    centre: NDArray[np.float64]  # [3]
    radius: float


def bounds_of(scene: Scene) -> Bounds:
    """The mean of the points and the 97th percentile of their distances from it; for few points the cameras' extent."""
    positions = finite(scene.points)
    if len(positions) < FEWEST_POINTS:
        return Bounds(*scene_extent([view.camera for view in scene.train_views], positions))
    centre = positions.mean(axis=0)
    radius = float(np.quantile(np.linalg.norm(positions - centre, axis=1), QUANTILE))
    return Bounds(centre, radius or 1.0)


def with_sky(scene: Scene, bounds: Bounds, count: int) -> Scene:
    """The scene with those of `count` points spread over the sky's sphere that a training view may see; pale ones.

    A scene of too few points to start from is left alone.
    """
    if not count or len(finite(scene.points)) < FEWEST_POINTS:
        return scene
    sphere = bounds.centre + DISTANCE * bounds.radius * fibonacci(count)
    sky = sphere[in_upper_part(sphere, [view.camera for view in scene.train_views])]
    positions = np.concatenate([scene.points.positions, sky])
    colours = np.concatenate([scene.points.colours, np.tile(PALE, (len(sky), 1))])
    return replace(scene, points=Points(positions, colours))


def with_room(config: TrainerConfig, bounds: Bounds, count: int, extent: float) -> TrainerConfig:
    """The training with Gaussians as large as those of the sky must be, which are far off: sizes are the scene's."""
    growth = config.strategy
    if not count or not isinstance(growth, DefaultStrategy):
        return config
    spacing = DISTANCE * bounds.radius * np.sqrt(4 * np.pi / count)
    return replace(
        config, strategy=replace(growth, prune_scale3d=max(growth.prune_scale3d, LARGEST * spacing / extent))
    )


def fibonacci(count: int) -> NDArray[np.float64]:
    """Evenly spread unit vectors [count, 3] (Gonzalez 2010): heights in equal steps, a golden angle further each."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)


def in_upper_part(positions: NDArray[np.float64], cameras: Sequence[Camera]) -> NDArray[np.bool_]:
    """Which positions [N] some camera sees in the upper two thirds of its picture."""
    seen = np.zeros(len(positions), bool)
    for camera in cameras:
        x, y, z = (positions @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]).T
        depth = np.where(z > 0, z, np.nan)  # comparisons with NaN are false
        u, v = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
        seen |= (u >= 0) & (u < camera.width) & (v >= 0) & (v < UPPER * camera.height)
    return seen


def finite(points: Points) -> NDArray[np.float64]:
    """The positions that are numbers."""
    positions = np.asarray(points.positions, np.float64)
    return positions[np.isfinite(positions).all(axis=1)]
