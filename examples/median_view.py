"""A whole method in one file: ask the nearest photographs what they see of a place, and take the median.

    make check METHOD=examples.median_view:MedianView
    make eval METHOD=examples.median_view:MedianView

Nothing is learned. The scene's points say how far away what a pixel shows will be; that place is looked up in the
photographs that were taken nearest. Rain stands somewhere else in each of them, so the median leaves most of it out.
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
NOWHERE = np.float32(np.nan)  # the colour of what lies outside a photograph, or is hidden in it


@dataclass(frozen=True)
class MedianConfig:
    """Everything that changes the result, for `config.json`."""

    photographs: int = 5  # that are asked, the nearest ones
    points: int = 8  # that a pixel's depth is the median of, the nearest ones in the image


class MedianView(Method):
    """The photographs, their cameras and the scene's points are the model."""

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
        """See Method; over too soon to be interrupted, so no checkpoint is written."""
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
        self._reach = float(np.median(ahead[ahead > 0]))  # how far away things are, typically

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
        """How far apart two cameras stand, and the places that they look at."""
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
    """What a photograph shows at places [H, W, 3] of the world: colours [H, W, 3], NOWHERE where it does not reach."""
    pixels, depths = camera.project(places.reshape(-1, 3))
    pixels[depths <= 0] = -2  # behind the camera
    x, y = (pixels.reshape(*places.shape[:2], 2) - 0.5).astype(np.float32).transpose(2, 0, 1)
    beyond = [float(NOWHERE)] * 3
    seen = cv2.remap(photograph, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond)
    return np.asarray(seen, np.float32)
