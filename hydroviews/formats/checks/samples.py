"""A few views of a capture, small, and where its points are in them: what several comparisons look at."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.scene.images import image_size, read_pixels, to_image
from hydroviews.scene.point_colours import evenly
from hydroviews.scene.scenes import Scene, View

POINTS = 6000  # of a scene that are looked at
VIEWS = 8  # at most whose pixels are read
BUDGET, JPEG_COST = 8e6, 0.25  # pixels that are decoded in all; of one in a JPEG, which is decoded smaller
SIDE = 600  # pixels of the longer side that a smaller picture keeps at least
CELLS = 60  # of the grid that tells which points are in front, along the longer side
BEHIND = 1.05  # of the depth in front: what lies deeper is hidden

Positions = NDArray[np.float64]  # [N, 3]


@dataclass(frozen=True)
class Sample:
    """Some points of a scene, and the pixels of a few of its views."""

    scene: Scene

    @cached_property
    def chosen(self) -> NDArray[np.int64]:
        """Which of the scene's points."""
        return evenly(len(self.scene.points), POINTS)

    @cached_property
    def positions(self) -> Positions:
        """Of the points [N, 3]."""
        return np.asarray(self.scene.points.positions[self.chosen], np.float64)

    @cached_property
    def colours(self) -> NDArray[np.float32]:
        """Of the points [N, 3], encoded, [0, 1]."""
        return np.asarray(self.scene.points.colours[self.chosen] / np.float32(255), np.float32)

    @cached_property
    def pictures(self) -> list[tuple[View, NDArray[np.float32]]]:
        """A few views, evenly spread, with their photographs as these are stored: [h, w, 3], encoded, [0, 1]."""
        views = self.scene.own_views
        return [(views[i], small_picture(views[i].path)) for i in evenly(len(views), affordable(views))]


def affordable(views: Sequence[View]) -> int:
    """How many photographs may be decoded, so that reading a capture does not take longer; one at least."""
    width, height = image_size(views[0].path)
    cost = width * height * (JPEG_COST if views[0].path.suffix.lower() in (".jpg", ".jpeg") else 1)
    return int(min(VIEWS, max(1, BUDGET // cost)))


def small_picture(path: Path) -> NDArray[np.float32]:
    """A photograph at a smaller size as it is stored, JPEGs decoded so: float32 [h, w, 3], encoded, [0, 1].

    Raises:
        InputError: it cannot be read.
    """
    factor = max(image_size(path)) // SIDE
    if path.suffix.lower() in (".jpg", ".jpeg") and factor >= 2:
        reduced = {8: cv2.IMREAD_REDUCED_COLOR_8, 4: cv2.IMREAD_REDUCED_COLOR_4, 2: cv2.IMREAD_REDUCED_COLOR_2}
        flag = reduced[max(one for one in reduced if one <= factor)] | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.fromfile(path, np.uint8), flag)
        if pixels is None:
            raise InputError(f"{path}: cannot be read as an image", fix="copy the file again; it may be cut short")
        return np.asarray(pixels[..., ::-1] / np.float32(255), np.float32)
    pixels = read_pixels(path)
    height, width = pixels.shape[:2]
    size = max(1, width // max(1, factor)), max(1, height // max(1, factor))
    return to_image(np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)))


def places(view: View, positions: Positions, pose: NDArray[np.float64] | None = None) -> tuple[NDArray, NDArray]:
    """Where points are in a photograph as it is stored.

    Args:
        view: its lens is taken into account.
        positions: [N, 3].
        pose: another world-to-camera [4, 4] than the view's.

    Returns:
        Across and down [N, 2], from 0 to 1 inside the photograph, and depths [N]; places mean nothing where the depth
        is not positive.
    """
    pose = view.camera.world_to_camera if pose is None else pose
    local = positions @ pose[:3, :3].T + pose[:3, 3]
    depth = local[:, 2].copy()
    local[depth <= 0] = (0, 0, 1)
    lens, camera = view.lens, view.camera
    if lens is None:
        pixels = local[:, :2] / local[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        return pixels / (camera.width, camera.height), depth
    return np.asarray(lens.colmap().img_from_cam(local)) / (lens.width, lens.height), depth


def inside(place: NDArray, depth: NDArray) -> NDArray[np.bool_]:
    """Which points [N] are in front of the camera and in the picture."""
    return np.asarray((depth > 0) & (place >= 0).all(axis=1) & (place < 1).all(axis=1))


def in_front(place: NDArray, depth: NDArray) -> NDArray[np.bool_]:
    """Which of those points [N] no other one hides, as far as a coarse grid tells."""
    seen = inside(place, depth)
    cells = (np.where(seen[:, None], place, 0) * CELLS).astype(int)
    nearest = np.full((CELLS, CELLS), np.inf)
    np.minimum.at(nearest, (cells[seen, 1], cells[seen, 0]), depth[seen])
    nearest = cv2.erode(nearest, np.ones((3, 3)), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(seen & (depth / BEHIND <= nearest[cells[:, 1], cells[:, 0]]))
