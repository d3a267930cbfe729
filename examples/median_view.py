"""A complete method in one file: the median colour of a place in the nearest photographs.

    make check METHOD=examples.median_view:MedianView
    make eval METHOD=examples.median_view:MedianView

The method trains nothing. The scene's points give the depth of a pixel, and so a place in the scene. The colour of that
place is read from the nearest photographs. Rain differs between photographs, so the median removes most of it.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from scipy.spatial import KDTree

from baselines.method import Method, TrainingSummary
from baselines.training.checkpoints import read_arrays, write_arrays
from hydroviews.errors import InputError
from hydroviews.profiles import find_profile
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene

MODEL = "photographs.safetensors"
NOWHERE = np.float32(np.nan)  # colour outside a photograph, and of hidden pixels


@dataclass(frozen=True)
class MedianConfig:
    """All settings that change the result, for `config.json`."""

    photographs: int = 5  # number of nearest photographs that are read
    points: int = 8  # number of nearest points in the image, whose median depth a pixel gets


class MedianView(Method):
    """The median of the nearest photographs. The model is the photographs, their cameras and the scene's points."""

    _model_mb: float | None = None

    @classmethod
    def configuration(cls, profile: str) -> MedianConfig:
        """See Method; the same at every size.

        Raises:
            InputError: no such profile.
        """
        find_profile(profile)
        return MedianConfig()

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method. It takes seconds, so no checkpoint is written."""
        start = time.perf_counter()
        if not len(scene.points):
            raise InputError(f"{scene.name}: no points", fix="estimate the cameras again, with points")
        photographs = []
        for view in scene.train_views:
            image, ignored = view.image(), view.ignored()
            photographs.append(image if ignored is None else np.where(ignored[..., None], NOWHERE, image))
        self._hold(photographs, [view.camera for view in scene.train_views], scene.points.positions)
        self._seconds = time.perf_counter() - start

    def _hold(self, photographs: list[Image], cameras: list[Camera], points: np.ndarray) -> None:
        self._photographs, self._cameras, self._points = photographs, cameras, points
        self._mean = np.nanmean([np.nanmean(image, axis=(0, 1)) for image in photographs], axis=0)
        ahead = np.concatenate([camera.project(points)[1] for camera in cameras])
        self._reach = float(np.median(ahead[ahead > 0]))  # typical depth

    def render(self, camera: Camera) -> Image:
        """See Method."""
        places = self._places(camera)
        nearest = sorted(range(len(self._cameras)), key=lambda i: self._apart(camera, self._cameras[i]))
        asked = nearest[: self.config.photographs]
        seen = np.stack([looked_up(self._photographs[i], self._cameras[i], places) for i in asked])
        unseen = np.isnan(seen).all(axis=0)
        seen[:, unseen] = 0
        return np.where(unseen, self._mean, np.nanmedian(seen, axis=0)).astype(np.float32)

    def _places(self, camera: Camera) -> np.ndarray:
        """The points of the world [H, W, 3] that the pixels show, at the depth of the points around them."""
        pixels, depths = camera.project(self._points)
        ahead = depths > 0
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        depth = np.full(x.shape, self._reach)
        if ahead.sum() >= self.config.points:
            around = KDTree(pixels[ahead]).query(np.stack([x, y], axis=-1), k=self.config.points)[1]
            depth = np.median(depths[ahead][around], axis=-1)
        local = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
        return (depth[..., None] * local) @ camera.rotation + camera.centre

    def _apart(self, one: Camera, two: Camera) -> float:
        """Distance of two cameras, plus the distance of the places that they look at."""
        stand, forward = one.centre - two.centre, one.rotation[2] - two.rotation[2]
        return float(np.linalg.norm(stand) + np.linalg.norm(stand + self._reach * forward))

    def save(self, folder: Path) -> None:
        """See Method."""
        arrays = {f"photograph-{i}": image for i, image in enumerate(self._photographs)}
        about = [{**vars(camera), "world_to_camera": camera.world_to_camera.tolist()} for camera in self._cameras]
        write_arrays(folder / MODEL, {**arrays, "points": self._points}, {"cameras": about, "seconds": self._seconds})
        self._model_mb = (folder / MODEL).stat().st_size / 1e6

    @classmethod
    def load(cls, config: MedianConfig, seed: int, folder: Path) -> Self:
        """See Method."""
        arrays, about = read_arrays(folder / MODEL)
        method = cls(config, seed)
        cameras = [Camera(**camera) for camera in about["cameras"]]
        method._hold([arrays[f"photograph-{i}"] for i in range(len(cameras))], cameras, arrays["points"])
        method._seconds, method._model_mb = about["seconds"], (folder / MODEL).stat().st_size / 1e6
        return method

    def summary(self) -> TrainingSummary:
        """See Method."""
        return TrainingSummary(self._seconds, n_primitives=None, model_mb=self._model_mb, device="cpu")


def looked_up(photograph: Image, camera: Camera, places: np.ndarray) -> Image:
    """Colours [H, W, 3] of a photograph at places [H, W, 3] of the world; NOWHERE outside the photograph."""
    pixels, depths = camera.project(places.reshape(-1, 3))
    pixels[depths <= 0] = -2  # behind the camera
    x, y = (pixels.reshape(*places.shape[:2], 2) - 0.5).astype(np.float32).transpose(2, 0, 1)
    beyond = [float(NOWHERE)] * 3
    seen = cv2.remap(photograph, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond)
    return np.asarray(seen, np.float32)
