"""A patterned wall with a box before it, seen by cameras that look the same way past two posts close before them."""

from pathlib import Path

import numpy as np

from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene

WALL, BOX, POST = 4.0, 3.0, 1.15  # distances; the box is one unit wide and high
POST_SIDES = 0.6, 0.85  # of the right post; the left one is its mirror image. Each is before a third of the cameras
POST_COLOUR = 0.1, 0.15, 0.1
WIDTH, HEIGHT, FOCAL = 32, 24, 30.0
ROWS, COLUMNS, APART = 4, 6, 0.2  # of cameras


def camera(x: float, y: float) -> Camera:
    """At (x, y, 0), looking along z."""
    pose = np.eye(4)
    pose[:2, 3] = -x, -y
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)


def pattern(x: np.ndarray, y: np.ndarray, phase: float) -> np.ndarray:
    """Colours [..., 3] of a plane at points of it."""
    waves = np.sin(3 * x + phase) * np.cos(2.5 * y - phase)
    return 0.5 + 0.4 * np.stack([waves, np.sin(2 * x - 3 * y + phase), np.cos(2 * y + x + phase)], -1)


def seen(x: float, y: float) -> np.ndarray:
    """The picture [H, W, 3] of the wall and the box alone."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    across, down = (columns - WIDTH / 2) / FOCAL, (rows - HEIGHT / 2) / FOCAL
    image = pattern(x + WALL * across, y + WALL * down, 0.0)
    on_box = (np.abs(x + BOX * across) < 0.5) & (np.abs(y + BOX * down) < 0.5)
    image[on_box] = pattern(x + BOX * across, y + BOX * down, 2.0)[on_box]
    return image.astype(np.float32)


def occluded(x: float, y: float) -> np.ndarray:
    """Where a post hides the scene, bool [H, W]."""
    across = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / FOCAL
    inner, outer = POST_SIDES
    at = np.abs(x + POST * across)
    return np.broadcast_to((at > inner) & (at < outer), (HEIGHT, WIDTH))


def photographed(folder: Path, occluders: bool = True) -> Scene:
    """The scene; training views with or without the posts, held-out ones without."""
    places = [((i % COLUMNS - 2.5) * APART, (i // COLUMNS - 1.5) * APART) for i in range(ROWS * COLUMNS)]
    views = [View(f"view-{i:02d}", camera(*place), folder / f"{i:02d}.png") for i, place in enumerate(places)]
    rng = np.random.default_rng(0)
    z = np.repeat([WALL, BOX, 1.0], (150, 50, 50))  # some points are as close as things may be
    spread = np.repeat([1.5, 0.45, 0.3], (150, 50, 50))[:, None]
    points = np.concatenate([spread * rng.uniform(-1, 1, (250, 2)), z[:, None]], 1)
    scene = make_scene("wall", views, Points(points, np.full((250, 3), 128, np.uint8)))
    for view, place in zip(views, places, strict=True):
        picture = seen(*place)
        if occluders and view.name in scene.split.train:
            picture[occluded(*place)] = POST_COLOUR
        write_png(view.path, picture)
    return scene
