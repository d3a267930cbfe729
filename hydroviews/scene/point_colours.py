"""Colours of a scene's points in the photographs that show them, known before any training.

Colours are looked up bilinearly in slightly blurred photographs. A point counts as shown where no depth map and no
other point says that something lies in front of it, and where nothing is masked.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.scene.cameras import Camera
from hydroviews.scene.depth import depth_path, fitted_depth
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene, View

BLUR, WINDOW = 1.0, 9  # standard deviation and width in pixels
POINTS, SCREEN, VIEWS = 4000, 20_000, 100  # looked up; that may hide others; views; all evenly chosen
BEHIND, BEHIND_POINTS = 1.02, 1.05  # of the depth in front, from a depth map or from points: what lies deeper is hidden


@dataclass(frozen=True)
class PointColours:
    """Colours of P points in V training views."""

    positions: NDArray[np.float64]  # [P, 3]
    views: NDArray[np.int64]  # [V], which of the training views, ascending
    centres: NDArray[np.float64]  # [V, 3], of the cameras
    colours: NDArray[np.float32]  # [P, V, 3], encoded, [0, 1]
    places: NDArray[np.float32]  # [P, V, 2], across and down the photograph, [0, 1]
    depths: NDArray[np.float32]  # [P, V], along the viewing axis, in scene units
    seen: NDArray[np.bool_]  # [P, V]; the rest of colours, places and depths means nothing where it is false


def look_up_points(scene: Scene, picture: Callable[[int], Image], title: str) -> PointColours:
    """Look up the scene's points in its training views, with a progress bar.

    Args:
        scene: at the size of the pictures.
        picture: [H, W, 3], encoded, of a training view by its number.
        title: of the bar.

    Raises:
        InputError: a mask or depth map that cannot be read.
    """
    positions = scene.points.positions[np.isfinite(scene.points.positions).all(axis=1)]
    positions = np.asarray(positions[evenly(len(positions), SCREEN)], np.float64)
    chosen = evenly(len(positions), POINTS)
    views = scene.train_views
    numbers = evenly(len(views), VIEWS)
    shape = len(chosen), len(numbers)
    colours, places = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 2), np.float32)
    depths, seen = np.zeros(shape, np.float32), np.zeros(shape, bool)
    for column, number in enumerate(tqdm(numbers, desc=title, unit="view", leave=False)):
        if len(chosen):
            camera = views[number].camera
            pixels, distances, visible = _visible(views[number], positions)
            seen[:, column], depths[:, column] = visible[chosen], distances[chosen]
            places[:, column] = pixels[chosen] / (camera.width, camera.height)
            colours[:, column] = _look_up(picture(number), pixels[chosen])
    centres = np.stack([views[number].camera.centre for number in numbers])
    return PointColours(positions[chosen], numbers, centres, colours, places, depths, seen)


def evenly(available: int, wanted: int) -> NDArray[np.int64]:
    """Indices of at most `wanted` of the available things."""
    return np.unique(np.linspace(0, max(available - 1, 0), min(available, wanted)).astype(np.int64))


def _visible(
    view: View, positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Pixels [N, 2] of points, (1, 1) for those outside the view, depths [N], and which the view shows unmasked [N]."""
    camera = view.camera
    pixels, depths = camera.project(positions)
    inside = (depths > 0) & (pixels >= 1).all(axis=1) & (pixels < (camera.width - 1, camera.height - 1)).all(axis=1)
    pixels = np.where(inside[:, None], pixels, 1.0)
    if depth_path(view).is_file():
        front = cv2.erode(fitted_depth(view.known(depth_path(view)), camera), np.ones((3, 3)))
        cell, behind = 1.0, BEHIND
    else:
        front, cell = _front_of_points(camera, pixels[inside], depths[inside])
        behind = BEHIND_POINTS
    columns, rows = (pixels / cell).astype(int).T
    shown = inside & (depths / behind <= front[rows, columns])
    ignored = view.ignored()
    if ignored is not None:
        columns, rows = pixels.astype(int).T
        drawn_from = np.ones((WINDOW + 2, WINDOW + 2))  # by the blur, then by the bilinear look-up
        shown &= cv2.dilate(ignored.astype(np.uint8), drawn_from)[rows, columns] == 0
    return pixels, depths, shown


def _front_of_points(
    camera: Camera, pixels: NDArray[np.float64], depths: NDArray[np.float64]
) -> tuple[NDArray[np.float32], float]:
    """The nearest point's depth around each cell of a grid about as fine as the points, and the cell's size."""
    cell = max(1.0, float(np.sqrt(camera.width * camera.height / max(len(pixels), 1))))
    shape = (int(camera.height / cell) + 1, int(camera.width / cell) + 1)
    nearest = np.full(shape, np.inf, np.float32)
    columns, rows = (pixels / cell).astype(int).T
    np.minimum.at(nearest, (rows, columns), depths.astype(np.float32))
    return np.asarray(cv2.erode(nearest, np.ones((3, 3)))), cell


def _look_up(image: Image, pixels: NDArray[np.float64]) -> NDArray[np.float32]:
    """Bilinear colours [N, 3] at pixels [N, 2] of the blurred picture."""
    blurred = cv2.GaussianBlur(image, (WINDOW, WINDOW), BLUR)
    places = (pixels - 0.5).astype(np.float32)[:, None]
    return np.asarray(cv2.remap(blurred, places, None, cv2.INTER_LINEAR)[:, 0])  # type: ignore[call-overload]
