"""Lenses with distortion, and the pinhole cameras their photographs are resampled to."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera, same_shape
from hydroviews.scene.checks import check_intrinsics, check_size
from hydroviews.scene.distortion import misuse
from hydroviews.scene.images import Image, row_blocks
from hydroviews.scene.quiet_pycolmap import pycolmap

# Undistorted pictures have no blank pixels: the field of view shrinks until the photograph covers all of it.
BLANK_PIXELS = 0.0

# Pixels over the photograph's below which another size than COLMAP's is looked for, and how much more that has to show.
CUT_OFF, BETTER = 0.5, 1.5
LARGEST, STEPS, BORDER = 2.0, 24, 41  # times the photograph's size; halvings; places along a side

KEPT_MAP = 24_000_000  # pixels up to which a lens's sampling map, 8 bytes each, is kept; two of them at a time


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
    """A COLMAP camera: model name (such as OPENCV_FISHEYE), the size it was calibrated at, and its parameters.

    Raises:
        InputError: an unknown model, a size or intrinsics that no camera has, or parameters too few, too many or not
            finite.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in pycolmap.CameraModelId.__members__ or self.model == "INVALID":
            raise InputError(f"{self.model}: unknown camera model", expected=f"one of {', '.join(_model_names())}")
        check_size(f"{self.model} camera", self.width, self.height)
        names, *places = _parameters(self.model)
        if len(self.params) != len(names.split(",")) or not all(map(math.isfinite, self.params)):
            raise InputError(
                f"{self.called}: bad parameters",
                found=f"{len(self.params)} numbers: {self.params}",
                expected=f"finite numbers {names}",
            )
        focal, centre = ([self.params[i] for i in indices] for indices in places)
        check_intrinsics(self.called, (self.width, self.height), focal, centre)

    @property
    def called(self) -> str:
        """What errors call it."""
        return f"{self.model} camera of {self.width}x{self.height}"

    @cached_property
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
            InputError: the lens sees too far to the side for any flat picture, as a panorama does, or its distortion
                folds: the undistorted picture would show a place of the photograph twice, or what is outside it.
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
        blocks = self.undistorted_rows(width, height, lambda rows: image[rows])
        return np.concatenate([block for _, block in blocks])

    def undistorted_rows(
        self, width: int, height: int, read_rows: Callable[[slice], Image]
    ) -> Iterator[tuple[slice, Image]]:
        """`undistort` a few rows at a time, in the memory that those take.

        Args:
            width: of the photograph.
            height: of the photograph.
            read_rows: gives some of its rows, float32 [h, W] or [h, W, C].

        Yields:
            Which rows of the undistorted picture, and these: float32 [h', W'] or [h', W', C].
        """
        for rows in row_blocks(self.pinhole((width, height)).height):
            x, y = _sampling_map(self, width, height, rows)
            first = min(max(int(y.min()) - 1, 0), height - 1)
            needed = slice(first, max(int(y.max()) + 3, first + 1))
            block = cv2.remap(
                read_rows(needed), x, y - np.float32(first), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            yield rows, np.asarray(block, np.float32)


def named_lens(where: str, model: str, width: int, height: int, params: Sequence[float]) -> Lens:
    """A lens from a file.

    Args:
        where: file and photograph or camera, for errors.
        model: see `Lens`, as the others.
        width: in pixels.
        height: in pixels.
        params: of the model.

    Raises:
        InputError: an unknown model, or against the rules of `scene.checks`.
    """
    try:
        return Lens(model, width, height, tuple(params))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


@cache
def _parameters(model: str) -> tuple[str, list[int], list[int]]:
    """The names of a camera model's parameters, and which are focal lengths and the principal point."""
    camera = pycolmap.Camera.create_from_model_name(1, model, 1.0, 1, 1)
    return camera.params_info, list(camera.focal_length_idxs()), list(camera.principal_point_idxs())


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
                f"{lens.called}: no pinhole camera can stand for it",
                found=error,
                fix="cut perspective pictures out of the panoramas and estimate their poses",
            ) from error
        camera = _less_cut_off(lens, camera)
    matrix = camera.calibration_matrix()
    pinhole = Pinhole(camera.width, camera.height, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    wrong = "" if lens.is_pinhole else misuse(lens.colmap(), camera)
    if wrong:
        raise InputError(
            f"{lens.called}: its distortion {wrong} the picture",
            found=f"parameters {lens.params}",
            expected="a photograph that shows every direction once",
            fix="calibrate the camera again, with a model of fewer parameters",
        )
    return pinhole


def _less_cut_off(lens: Lens, camera: pycolmap.Camera) -> pycolmap.Camera:
    """COLMAP's undistorted camera, or a larger one where that is much smaller than the photograph.

    COLMAP shrinks a picture to a fifth where one corner of the photograph has no direction. The larger one is the
    largest picture of the photograph's shape around the optical axis that lies within the photograph.
    """
    if camera.width * camera.height >= CUT_OFF * lens.width * lens.height:
        return camera
    share = kept_share(lens, camera)
    x, y = (camera.calibration_matrix()[i, i] for i in range(2))
    low, high = 0.0, LARGEST
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if _fits(lens, _centred(lens, middle, x, y)) else (low, middle)
    larger = _centred(lens, low, x, y) if low > 0 else camera
    return larger if low > 0 and kept_share(lens, larger) > BETTER * share else camera


def _centred(lens: Lens, factor: float, fx: float, fy: float) -> pycolmap.Camera:
    """A pinhole camera of the lens's shape, that many times its size, with the axis in its middle."""
    width, height = max(1, round(factor * lens.width)), max(1, round(factor * lens.height))
    params = [fx, fy, width / 2, height / 2]
    return pycolmap.Camera(model="PINHOLE", width=width, height=height, params=params, camera_id=1)


def _fits(lens: Lens, camera: pycolmap.Camera) -> bool:
    """Whether each direction of an undistorted picture is in the photograph, once."""
    across, down = np.linspace(0, camera.width, BORDER), np.linspace(0, camera.height, BORDER)
    edges = [(x, y) for x in across for y in (0, camera.height)] + [(x, y) for x in (0, camera.width) for y in down]
    matrix = camera.calibration_matrix()
    rays = np.ones((len(edges), 3))
    rays[:, :2] = (np.array(edges) - matrix[:2, 2]) / (matrix[0, 0], matrix[1, 1])
    pixels = np.asarray(lens.colmap().img_from_cam(rays))
    inside = np.isfinite(pixels).all() and (pixels >= 0).all() and (pixels <= (lens.width, lens.height)).all()
    return bool(inside and not misuse(lens.colmap(), camera))


def kept_share(lens: Lens, camera: pycolmap.Camera | None = None) -> float:
    """The share of a photograph's pixels that its undistorted picture shows, on a grid.

    Args:
        lens: the photograph's.
        camera: the undistorted picture's; `lens.pinhole()` if not given.
    """
    if camera is None:
        size = lens.pinhole()
        width, height, *params = size
        camera = pycolmap.Camera(model="PINHOLE", width=width, height=height, params=params, camera_id=1)
    places = (np.stack(np.meshgrid(*2 * [np.arange(BORDER) + 0.5]), axis=-1) / BORDER).reshape(-1, 2)
    places = places * (lens.width, lens.height)
    matrix = camera.calibration_matrix()
    with np.errstate(all="ignore"):
        rays = np.ones((len(places), 3))
        rays[:, :2] = np.asarray(lens.colmap().cam_from_img(places), np.float64)[:, :2]
        back = np.asarray(lens.colmap().img_from_cam(np.nan_to_num(rays)))
        ahead = np.isfinite(rays).all(axis=1) & (np.abs(back - places) < 1).all(axis=1)  # not behind the camera
        pixels = rays[:, :2] * (matrix[0, 0], matrix[1, 1]) + matrix[:2, 2]
    shown = (pixels >= 0).all(axis=1) & (pixels <= (camera.width, camera.height)).all(axis=1)
    return float((ahead & shown).mean())


def _sampling_map(lens: Lens, width: int, height: int, rows: slice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """For each pixel of some rows of the pinhole picture, the photograph's array position [h', W'] to sample."""
    if width * height > KEPT_MAP:
        return _sampled_places(lens, width, height, rows)
    x, y = _whole_map(lens, width, height)
    return x[rows], y[rows]


@lru_cache(maxsize=2)
def _whole_map(lens: Lens, width: int, height: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`_sampling_map` of all rows, kept for the other photographs of the same lens."""
    blocks = row_blocks(lens.pinhole((width, height)).height)
    x, y = zip(*(_sampled_places(lens, width, height, rows) for rows in blocks), strict=True)
    return np.concatenate(x), np.concatenate(y)


def _sampled_places(
    lens: Lens, width: int, height: int, rows: slice
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`_sampling_map`, computed."""
    target, camera = lens.pinhole((width, height)), lens.colmap()
    scale = np.array([width / lens.width, height / lens.height])
    across = (np.arange(target.width) + 0.5 - target.cx) / target.fx
    down = (np.arange(rows.start, rows.stop) + 0.5 - target.cy) / target.fy
    y, x = np.meshgrid(down, across, indexing="ij")
    pixels = np.asarray(camera.img_from_cam(np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)))
    pixels *= scale
    pixels -= 0.5
    sampled = pixels.astype(np.float32).reshape(*x.shape, 2)
    if not np.isfinite(sampled).all():
        raise InputError(
            f"{lens.called}: its distortion is undefined inside the picture",
            found=f"parameters {lens.params}",
            fix="calibrate the camera again, with a model of fewer parameters",
        )
    return np.ascontiguousarray(sampled[..., 0]), np.ascontiguousarray(sampled[..., 1])
