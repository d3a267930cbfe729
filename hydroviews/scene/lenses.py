"""Lenses with distortion, and the pinhole cameras their photographs are resampled to."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera, same_shape
from hydroviews.scene.images import Image

# Undistorted pictures have no blank pixels: the field of view shrinks until the photograph covers all of it.
BLANK_PIXELS = 0.0

ROWS_AT_ONCE = 64  # bounds the memory that preparing a large picture takes


class Pinhole(NamedTuple):
    """An image size and pinhole intrinsics, all in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def resized(self, width: int, height: int) -> "Pinhole":
        """The same field of view at another size: the exact factor along each axis."""
        x, y = width / self.width, height / self.height
        return Pinhole(width, height, self.fx * x, self.fy * y, self.cx * x, self.cy * y)

    def camera(self, world_to_camera: NDArray) -> Camera:
        """A view's camera with these intrinsics."""
        return Camera(*self, world_to_camera)


@dataclass(frozen=True)
class Lens:
    """A COLMAP camera: model name (such as OPENCV_FISHEYE), the size it was calibrated at, and its parameters."""

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in pycolmap.CameraModelId.__members__ or self.model == "INVALID":
            raise InputError(f"{self.model}: unknown camera model", expected=f"one of {', '.join(_model_names())}")
        names = pycolmap.Camera.create_from_model_name(1, self.model, 1.0, self.width, self.height).params_info
        if len(self.params) != len(names.split(",")) or not np.isfinite(self.params).all():
            raise InputError(
                f"{self.model} camera of {self.width}x{self.height}: bad parameters",
                found=f"{len(self.params)} numbers: {self.params}",
                expected=f"finite numbers {names}",
            )

    @property
    def is_pinhole(self) -> bool:
        """Whether it has no distortion, so that photographs are used as they are."""
        camera = self.colmap()
        # Without coefficients, pycolmap calls a fisheye undistorted as well.
        return bool(camera.is_undistorted() and camera.is_perspective() and not camera.is_perspective_fisheye())

    def colmap(self) -> pycolmap.Camera:
        """The same camera as pycolmap's object."""
        return pycolmap.Camera(
            model=self.model, width=self.width, height=self.height, params=np.array(self.params), camera_id=1
        )

    def pinhole(self, size: tuple[int, int] | None = None) -> Pinhole:
        """The largest pinhole camera without blank pixels that its photographs can be resampled to.

        The focal lengths stay; the size changes so that every pixel is covered by the photograph
        (COLMAP's undistortion with `blank_pixels` 0).

        Args:
            size: width and height of the photographs, where they are not what the lens was calibrated at.

        Raises:
            InputError: the lens sees too far to the side for any flat picture, as a panorama does.
        """
        exact = _pinhole(self)
        if size is None or size == (self.width, self.height):
            return exact
        x, y = size[0] / self.width, size[1] / self.height
        return exact.resized(max(1, round(exact.width * x)), max(1, round(exact.height * y)))

    def undistort(self, image: Image) -> Image:
        """Resample a photograph to `pinhole(its size)`, bilinearly in encoded values.

        Args:
            image: float32 [H, W, 3], of the lens's size or of another size of the same shape.

        Returns:
            float32 [H', W', 3].

        Raises:
            ValueError: the photograph has another shape than the lens.
        """
        height, width = image.shape[:2]
        if not same_shape((width, height), (self.width, self.height)):
            raise ValueError(
                f"a photograph of {width}x{height} was not taken with a lens of {self.width}x{self.height}"
            )
        if self.is_pinhole:
            return image
        x, y = _sampling_map(self, width, height)
        resampled = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(resampled, np.float32)


def _model_names() -> list[str]:
    return [name for name in pycolmap.CameraModelId.__members__ if name != "INVALID"]


@lru_cache(maxsize=256)
def _pinhole(lens: Lens) -> Pinhole:
    camera = lens.colmap()
    if not lens.is_pinhole:
        try:
            camera = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(blank_pixels=BLANK_PIXELS), camera)
        except ValueError as error:
            raise InputError(
                f"{lens.model} camera of {lens.width}x{lens.height}: no pinhole camera can stand for it",
                found=error,
                fix="cut perspective pictures out of the panoramas and estimate their poses",
            ) from error
    matrix = camera.calibration_matrix()
    return Pinhole(camera.width, camera.height, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])


@lru_cache(maxsize=2)  # two maps of 12 megapixels take 200 MB
def _sampling_map(lens: Lens, width: int, height: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """For each pixel of the pinhole picture, the photograph's array position [H', W'] to sample."""
    target, camera = lens.pinhole((width, height)), lens.colmap()
    scale = np.array([width / lens.width, height / lens.height])
    columns = (np.arange(target.width) + 0.5 - target.cx) / target.fx
    rows = (np.arange(target.height) + 0.5 - target.cy) / target.fy
    sampled = np.empty((target.height, target.width, 2), np.float32)
    for start in range(0, target.height, ROWS_AT_ONCE):
        block = slice(start, start + ROWS_AT_ONCE)
        y, x = np.meshgrid(rows[block], columns, indexing="ij")
        pixels = camera.img_from_cam(np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3))
        sampled[block] = (pixels * scale - 0.5).reshape(*x.shape, 2)
    if not np.isfinite(sampled).all():
        raise InputError(
            f"{lens.model} camera of {lens.width}x{lens.height}: its distortion is undefined inside the picture",
            found=f"parameters {lens.params}",
            fix="calibrate the camera again, with a model of fewer parameters",
        )
    return np.ascontiguousarray(sampled[..., 0]), np.ascontiguousarray(sampled[..., 1])
