"""A room that is learned in seconds, drawn with numpy: what methods are tried on before they see a scene."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from baselines.rendering.camera_paths import look_at
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene
from hydroviews.scene.seeds import generator

WALLS = np.array([1.6, 1.0, 1.3])  # from the room's middle to its walls, y down
N_VIEWS, WIDTH, HEIGHT, FOCAL = 9, 48, 36, 40.0
RADIUS, SINK = 0.6, 0.15  # of the circle on which cameras stand, and how far below it they look
WAVES = 5.0  # radians per unit of the walls' patterns, typically
POINTS = 40  # a view


def draw_room(folder: Path, seed: int = 0, n_views: int = N_VIEWS) -> Scene:
    """Views from a circle across a room with coloured walls, every eighth held out, with points on the walls.

    Args:
        folder: for the pictures.
        seed: another one gives walls of other colours.
        n_views: evenly along the circle.
    """
    paint = generator(seed, "room", "walls")
    waves, phases = paint.normal(0, WAVES, (3, 3)), paint.uniform(0, 2 * np.pi, 3)
    views, positions = [], []
    for index in range(n_views):
        camera = _camera(2 * np.pi * index / n_views)
        hits = _hits(camera)
        view = View(f"view-{index:02d}", camera, folder / f"view-{index:02d}.png")
        write_png(view.path, _colours(hits, waves, phases))
        views.append(view)
        positions.append(generator(0, "room", "points", index).choice(hits.reshape(-1, 3), POINTS, replace=False))
    points = np.concatenate(positions)
    colours = np.rint(255 * _colours(points, waves, phases)).astype(np.uint8)
    return make_scene("room", views, Points(points, colours))


def _camera(angle: float) -> Camera:
    """On a circle about the middle of the room, looking across it."""
    eye = RADIUS * np.array([np.cos(angle), 0, np.sin(angle)])
    pose = look_at(eye, np.array([0, SINK, 0]), np.array([0, -1.0, 0]))
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)


def _hits(camera: Camera) -> NDArray[np.float64]:
    """Where the rays through the pixels meet a wall [H, W, 3]: the nearest of the three planes ahead."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    rays = local @ camera.rotation
    with np.errstate(divide="ignore"):
        distance = ((np.sign(rays) * WALLS - camera.centre) / rays).min(axis=-1)
    return camera.centre + distance[..., None] * rays


def _colours(positions: NDArray[np.float64], waves: NDArray, phases: NDArray) -> Image:
    """A smooth pattern [..., 3] in [0.1, 0.9] of positions [..., 3]."""
    return (0.5 + 0.4 * np.sin(positions @ waves + phases)).astype(np.float32)
