"""A scene: named views with cameras and images, sparse points, and a split. Every method gets one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.known_bytes import require_bytes
from hydroviews.scene.cameras import Camera, fitted_size, same_shape
from hydroviews.scene.exif import ON_ITS_SIDE, orientation
from hydroviews.scene.images import Image, read_pixels, resize_area, row_blocks, to_image, to_rgb, to_uint8
from hydroviews.scene.lenses import Lens
from hydroviews.scene.masks import TOUCHED, Ignored, fit_ignored, read_ignored, read_transparent, write_ignored

TEST_EVERY = 8
SPARSE_EVERY = 3


@dataclass(frozen=True)
class View:
    """A photograph and its camera.

    Attributes:
        name: file name without folder and suffix, unique in its scene.
        camera: pinhole camera of the picture that `image` returns.
        path: the photograph.
        lens: the photograph's own camera; None where it is a pinhole camera.
        mask: file that hides part of the photograph (see `hydroviews.scene.masks`); the photograph itself where its
            transparent pixels are hidden.
        listed: SHA-256 by path, of files of a data set, whose bytes are compared when they are read; any other file
            is read as it is.
    """

    name: str
    camera: Camera
    path: Path
    lens: Lens | None = None
    mask: Path | None = None
    listed: Mapping[Path, str] = field(default_factory=dict, repr=False, compare=False)

    def known(self, path: Path) -> Path:
        """A file of the view, to be read: unchanged since it was listed, if it was.

        Raises:
            InputError: it is listed, and missing or changed.
        """
        return require_bytes(path, self.listed[path]) if path in self.listed else path

    def image(self) -> Image:
        """Read the picture, undistorted: float32 [H, W, 3], sRGB-encoded, [0, 1], at the camera's size.

        Raises:
            InputError: missing, changed since it was listed, unreadable, smaller than the camera, or of another shape.
        """
        pixels = self._pixels()
        if self.lens is None and pixels.shape[:2] == (self.camera.height, self.camera.width):
            return to_image(pixels)
        planes = self._planes(pixels)
        return np.stack([resize_area(plane, self.camera.width, self.camera.height) for plane in planes], axis=-1)

    def rounded(self) -> NDArray[np.uint8]:
        """`image` rounded to 8 bits: uint8 [H, W, 3].

        Takes at most 16 bytes for each pixel of an undistorted 8-bit photograph, beside the maps that `lenses` keeps.

        Raises:
            InputError: see `image`.
        """
        planes = self._planes(self._pixels())
        rounded = np.empty((self.camera.height, self.camera.width, 3), np.uint8)
        for channel in range(3):
            plane = resize_area(planes.pop(0), self.camera.width, self.camera.height)
            for rows in row_blocks(len(plane)):
                rounded[rows, :, channel] = to_uint8(plane[rows])
        return rounded

    def _pixels(self) -> NDArray[np.uint8 | np.uint16]:
        """The photograph, checked to have the camera's shape and at least its size."""
        pixels = read_pixels(self.known(self.path))
        if self.mask == self.path and pixels.ndim == 3:
            pixels = pixels[..., :3]  # what is transparent is hidden, and need not become black
        found, wanted = (pixels.shape[1], pixels.shape[0]), (self.camera.width, self.camera.height)
        if self.lens is not None and not same_shape(found, (self.lens.width, self.lens.height)):
            raise wrong_size(self.path, found, (self.lens.width, self.lens.height))
        size = self.lens.pinhole(found)[:2] if self.lens is not None else found
        if not same_shape(size, wanted) or size < wanted:
            raise wrong_size(self.path, found, wanted)
        return pixels

    def _planes(self, pixels: NDArray[np.uint8 | np.uint16]) -> list[Image]:
        """The red, green and blue of the undistorted photograph, each float32 [H, W] at its own size."""
        height, width = pixels.shape[:2]
        blocks: Iterator[tuple[slice, Image]] = ((rows, to_rgb(pixels[rows])) for rows in row_blocks(height))
        if self.lens is not None and not self.lens.is_pinhole:
            blocks = self.lens.undistorted_rows(width, height, lambda rows: to_rgb(pixels[rows]))
            width, height = self.lens.pinhole((width, height))[:2]
        planes = [np.empty((height, width), np.float32) for _ in range(3)]
        for rows, block in blocks:
            for plane, channel in zip(planes, np.moveaxis(block, 2, 0), strict=True):
                plane[rows] = channel
        return planes

    def ignored(self) -> Ignored | None:
        """The mask, undistorted and resized like the picture: bool [H, W], True where pixels are ignored.

        A pixel that a hidden one touches is ignored. None where the view has no mask, or one that hides nothing.

        Raises:
            InputError: the mask is unreadable, changed since it was listed, or of another shape than the photograph.
        """
        if self.mask is None:
            return None
        read = read_transparent if self.mask == self.path else read_ignored
        ignored = read(self.known(self.mask))
        fitted = self.fit_mask(ignored, self.mask)
        return fitted if ignored.any() else None

    def write_mask(self, path: Path) -> None:
        """Write what is ignored of the picture, be it nothing.

        Raises:
            InputError: see `ignored`.
        """
        ignored = self.ignored()
        nothing = np.zeros((self.camera.height, self.camera.width), np.bool_)
        write_ignored(path, nothing if ignored is None else ignored)

    def fit_mask(self, ignored: Ignored, origin: Path) -> Ignored:
        """Undistort and resize a mask [H, W] of the photograph like the picture; `origin` is its file, for errors.

        Raises:
            InputError: it has another shape than the photograph.
        """
        size = (ignored.shape[1], ignored.shape[0])
        expected = (self.camera.width, self.camera.height)
        if self.lens is not None:
            expected = (self.lens.width, self.lens.height)
        if not same_shape(size, expected):
            raise wrong_size(origin, size, expected)
        if self.lens is not None:
            ignored = np.asarray(self.lens.undistort(ignored.astype(np.float32)) > TOUCHED)
        return fit_ignored(ignored, self.camera.width, self.camera.height)


def wrong_size(path: Path, found: tuple[int, int], expected: tuple[int, int]) -> InputError:
    """The error for a photograph that its camera was not estimated from, or that lies on its side."""
    size, fix = (
        f"{found[0]}x{found[1]} pixels",
        "use the images that the cameras were estimated from, all resized alike",
    )
    if same_shape(found[::-1], expected) and orientation(path) in ON_ITS_SIDE:
        size += f", by Exif's Orientation {orientation(path)} to be shown as {found[1]}x{found[0]}"
        fix = "save the photographs upright, since the cameras are those of upright ones (`mogrify -auto-orient`)"
    return InputError(
        f"{path}: image and camera differ in size",
        found=size,
        expected=f"{expected[0]}x{expected[1]}, or a larger image of the same shape",
        fix=fix,
    )


@dataclass(frozen=True)
class Points:
    """Sparse scene points: positions [N, 3] in world units, colours [N, 3] uint8."""

    positions: NDArray[np.float64]
    colours: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.positions)


def no_points() -> Points:
    """An empty cloud."""
    return Points(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))


@dataclass(frozen=True)
class Observed:
    """Where a structure-from-motion model has its own points in a photograph."""

    places: NDArray[np.float64]  # [K, 2], across and down the photograph, from 0 to 1
    positions: NDArray[np.float64]  # [K, 3]
    colours: NDArray[np.uint8]  # [K, 3]


@dataclass(frozen=True)
class Split:
    """Names of training and held-out views; `sparse` are the training views of the sparse-view track."""

    train: tuple[str, ...]
    test: tuple[str, ...]
    sparse: tuple[str, ...] = ()


def every_eighth(names: Sequence[str]) -> Split:
    """Every 8th view by name, starting with the first, is held out (the split of Mip-NeRF 360)."""
    ordered = sorted(names)
    test = tuple(ordered[::TEST_EVERY])
    return Split(tuple(n for n in ordered if n not in set(test)), test)


def every_third(train: Sequence[str]) -> tuple[str, ...]:
    """Every 3rd training view by name, starting with the first; the first and the last where that is only one."""
    ordered = sorted(train)
    chosen = ordered[::SPARSE_EVERY]
    return tuple(chosen if len(chosen) > 1 else [ordered[0], ordered[-1]])


@dataclass(frozen=True)
class Scene:
    """Views in order of their names, points, a split, and notes about the capture for people to read."""

    name: str
    views: tuple[View, ...]
    points: Points
    split: Split
    notes: tuple[str, ...] = field(default=())
    captured_rainy: bool = False  # it rained when the photographs were taken
    clean_views: tuple[View, ...] = ()  # clean photographs beside those, of views of the same names and cameras
    metres_per_unit: float | None = None  # where it is known
    clean_error: float | None = None  # of plain 3DGS on clean views, see `formats.capture_json`; where it is known
    drops_cost: float = 1.0  # measured over predicted cost of drops that stay to plain 3DGS; 1 where it is not known
    observed: Mapping[str, Observed] = field(default_factory=dict, repr=False, compare=False)  # in a few views, by name

    @property
    def train_views(self) -> tuple[View, ...]:
        """The views a method may learn from."""
        return self._select(self.split.train)

    @property
    def test_views(self) -> tuple[View, ...]:
        """The held-out views."""
        return self._select(self.split.test)

    @property
    def own_views(self) -> tuple[View, ...]:
        """The views but those that have a clean photograph alone, in a scene that was captured in rain."""
        clean = {view.path for view in self.clean_views}
        return tuple(view for view in self.views if view.path not in clean)

    def sparse(self) -> "Scene":
        """The same scene with only its sparse views to train on."""
        return replace(self, split=replace(self.split, train=self.split.sparse))

    def _select(self, names: Sequence[str]) -> tuple[View, ...]:
        by_name = {view.name: view for view in self.views}
        return tuple(by_name[name] for name in names)

    def resized(self, long_side: int | None) -> "Scene":
        """The scene with cameras fitted to `long_side` pixels; images are area-averaged when they are read."""
        return replace(self, views=_resized(self.views, long_side), clean_views=_resized(self.clean_views, long_side))


def _resized(views: Sequence[View], long_side: int | None) -> tuple[View, ...]:
    return tuple(replace(view, camera=view.camera.resized(*_fitted(view.camera, long_side))) for view in views)


def _fitted(camera: Camera, long_side: int | None) -> tuple[int, int]:
    return fitted_size(camera.width, camera.height, long_side)


def make_scene(
    name: str,
    views: Sequence[View],
    points: Points,
    split: Split | None = None,
    notes: Sequence[str] = (),
) -> Scene:
    """Make and check a scene: views are sorted by name, a split and its sparse views chosen where none are given.

    Raises:
        InputError: no views, two of one name, fewer than two to train on, a split that names absent views or
            lists one twice, or sparse views that are no training views.
    """
    ordered = tuple(sorted(views, key=lambda view: view.name))
    names = [view.name for view in ordered]
    if not names:
        raise InputError(f"{name}: no view with a camera", expected="at least three registered images")
    twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise InputError(f"{name}: several images share a name", found=", ".join(twice[:5]), fix="rename them")
    split = split or every_eighth(names)
    absent = sorted(set(split.train + split.test) - set(names))
    if absent:
        raise InputError(
            f"{name}: the split names views that are not there",
            found=", ".join(absent[:5]),
            fix="correct split.json, or remove it to have it drawn again",
        )
    listed = split.train + split.test
    if len(set(listed)) < len(listed):
        raise InputError(
            f"{name}: the split lists views twice",
            found=", ".join(sorted({n for n in listed if listed.count(n) > 1})[:5]),
            expected="each view once, to train on or held out",
            fix="correct split.json, or remove it to have it drawn again",
        )
    if len(split.train) < 2 or not split.test:
        raise InputError(
            f"{name}: too few views",
            found=f"{len(split.train)} to train on, {len(split.test)} held out",
            expected="at least two to train on and one held out (every 8th by name), so at least three images",
            fix="add photographs, or estimate the poses again so that more of them register",
        )
    return Scene(name, ordered, points, _with_sparse(name, split), tuple(notes))


def _with_sparse(name: str, split: Split) -> Split:
    if not split.sparse:
        return replace(split, sparse=every_third(split.train))
    odd = sorted(set(split.sparse) - set(split.train))
    if odd or len(set(split.sparse)) < len(split.sparse) or len(split.sparse) < 2:
        raise InputError(
            f"{name}: the split's sparse views are no choice of its training views",
            found=", ".join(odd[:5]) or f"{len(split.sparse)} views, {len(set(split.sparse))} of them different",
            expected="at least two training views, each once",
            fix="correct split.json, or remove its sparse views to have them drawn again",
        )
    return split
