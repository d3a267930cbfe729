"""Drops on lenses, before views that are never read."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hydroviews.rain.lens.patterns.pattern import RaindropPattern, draw_pattern
from hydroviews.rain.lens.patterns.shapes import Outline
from hydroviews.rain.lens.patterns.water import Drop, Water
from hydroviews.rain.lens.raindrops import PreparedLens, Raindrops
from hydroviews.rain.scene_statistics import Light, SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import View, no_points

PATTERN = replace(
    draw_pattern(np.random.default_rng(3), 1), coverage=0.15, radius_median=0.05, droplets=20, rivulets=1, seed=1
)
DRY = replace(PATTERN, coverage=0.0, droplets=0, rivulets=0, mist=0.0)
LIGHT = Light(mean=(0.2, 0.2, 0.2), air=(0.6, 0.7, 0.8))


def camera(width: int, height: int) -> Camera:
    """At the origin, looking along z."""
    return Camera(width, height, 0.8 * width, 0.8 * width, width / 2, height / 2, np.eye(4))


def one_drop(x: float, y: float, radius: float, degrees: float = 50.0) -> Water:
    """A round drop at x, y, in sides."""
    return Water((Drop(Outline(((x, y, radius),)), np.radians(degrees)),), (), np.zeros((0, 4)))


def raindrops(pattern: RaindropPattern, lens: Camera, count: int = 7) -> tuple[Raindrops, list[View]]:
    """The rain over a scene of some views, and the views."""
    views = [View(f"view-{i}", lens, Path("none.png")) for i in range(count)]
    statistics = SceneStatistics("none", 0, tuple(views), no_points(), 1 / count, (), 0.0, LIGHT)
    return Raindrops(pattern, statistics), views


def prepared_lens(
    pattern: RaindropPattern, lens: Camera, folder: Path, count: int = 7
) -> tuple[PreparedLens, list[View]]:
    """The lens, whose bakes are kept in the folder, and its views."""
    rain, views = raindrops(pattern, lens, count)
    return rain.prepare(lens, folder), views
