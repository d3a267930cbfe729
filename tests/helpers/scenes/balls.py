"""A ball with coloured stripes before a patterned sky, photographed by exact ray casting."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from splats import camera

from baselines.volumetric.config import GridConfig, HashFieldConfig, VolumetricConfig
from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.rays.rays import camera_rays
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene

SMALL = VolumetricConfig(
    iterations=300,
    rays=256,
    proposal_samples=32,
    samples=16,
    anneal=100,
    warm_up=10,
    field=HashFieldConfig(
        grid=GridConfig(4, 12, 8, 64), hidden=16, colour_layers=1, proposal_grid=GridConfig(3, 10, 8, 32), rate=3e-2
    ),
)
SHORT = replace(SMALL, iterations=200, anneal=66)  # where that tells methods apart as well


class Plain(RadianceMethod):
    """A field alone, of a plain configuration: what methods are compared with."""


def seen(view_camera, radius: float = 1.0) -> np.ndarray:
    """The picture [H, W, 3]: stripes on the ball, elsewhere a pattern infinitely far away."""
    rays = camera_rays(view_camera)
    directions = rays.directions / np.linalg.norm(rays.directions, axis=1, keepdims=True)
    middle = -(rays.origins * directions).sum(1)
    inside = middle**2 - (rays.origins**2).sum(1) + radius**2
    t = middle - np.sqrt(np.maximum(inside, 0))
    points = rays.origins + t[:, None] * directions
    stripes = 0.5 + 0.4 * np.sin(4 * points + [0, 1, 2])
    sky = 0.5 + 0.3 * np.sin(6 * directions + [2, 0, 1])
    image = np.where(inside[:, None] > 0, stripes, sky)
    return image.reshape(view_camera.height, view_camera.width, 3).astype(np.float32)


def photographed(folder: Path, n_views: int = 24, width: int = 32, height: int = 24, change=None) -> Scene:
    """Cameras in a ring; `change(image, index)` spoils the training views' pictures."""
    views, pictures = [], []
    for index in range(n_views):
        path = folder / f"{index:02d}.png"
        views.append(View(f"view-{index:02d}", camera(width, height, 2 * np.pi * index / n_views), path))
        pictures.append(seen(views[-1].camera))
    directions = np.random.default_rng(0).normal(size=(200, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    scene = make_scene("ball", views, Points(points, np.full((200, 3), 128, np.uint8)))
    for index, (view, picture) in enumerate(zip(views, pictures, strict=True)):
        spoilt = change is not None and view.name in scene.split.train
        write_png(view.path, change(picture, index) if spoilt else picture)
    return scene


def psnr(render, views) -> float:
    """Mean over views of a function from camera to picture."""
    errors = [np.mean((render(view.camera) - view.image()) ** 2) for view in views]
    return float(np.mean(-10 * np.log10(errors)))
