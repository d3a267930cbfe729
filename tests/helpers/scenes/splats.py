"""Small made-up scenes for the splatting tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from synthetic import looking_at_origin

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.rasterizer import render
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene

BACKGROUND = np.array([0.1, 0.2, 0.3], np.float32)


def camera(width: int, height: int, angle: float = 0.3, origin: tuple[float, float, float] = (0, 0, 0)) -> Camera:
    """Four units from the origin, looking at it, on a circle slightly above."""
    eye = np.array([4 * np.cos(angle), -0.6, 4 * np.sin(angle)])
    pose = looking_at_origin(eye)
    pose[:3, 3] = -pose[:3, :3] @ (eye + origin)
    focal = 0.9 * max(width, height)
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)


def cloud(n: int, degree: int = 3, seed: int = 0, size: float = 0.12) -> Gaussians:
    """Random Gaussians of all shapes and opacities within about one unit of the origin."""
    generator = np.random.default_rng(seed)
    sh = 0.15 * generator.normal(size=(n, (degree + 1) ** 2, 3))
    sh[:, 0] = generator.uniform(-1.5, 1.5, (n, 3))
    return Gaussians(
        means=generator.uniform(-1, 1, (n, 3)).astype(np.float32),
        quaternions=generator.normal(size=(n, 4)).astype(np.float32),
        log_scales=(np.log(size) + 0.6 * generator.normal(size=(n, 3))).astype(np.float32),
        opacity_logits=(1.8 * generator.normal(size=n)).astype(np.float32),
        sh=sh.astype(np.float32),
    )


def with_values(gaussians: Gaussians, name: str, rows: object, value: object) -> Gaussians:
    """A copy with some rows of one parameter set."""
    changed = getattr(gaussians, name).copy()
    changed[rows] = value
    return replace(gaussians, **{name: changed})


def photographed(folder: Path, n_views: int = 12, width: int = 48, height: int = 36) -> Scene:
    """A scene whose pictures are renders of `cloud`, with a rough point cloud of it."""
    truth = cloud(60, degree=0, seed=3, size=0.15)
    views = []
    for index in range(n_views):
        seen_by = camera(width, height, 2 * np.pi * index / n_views)
        view = View(f"view-{index:02d}", seen_by, folder / f"{index:02d}.png")
        write_png(view.path, np.clip(render(truth, view.camera)[0], 0, 1))
        views.append(view)
    noise = np.random.default_rng(0).normal(0, 0.03, truth.means.shape)
    colours = np.clip(255 * (0.5 + 0.282 * truth.sh[:, 0]), 0, 255).astype(np.uint8)
    points = Points(np.repeat(truth.means + noise, 2, axis=0).astype(np.float64), np.repeat(colours, 2, axis=0))
    return make_scene("synthetic", views, points)
