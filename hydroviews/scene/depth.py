"""Depth maps of views: rendered ones where a capture has them, estimated from its sparse points otherwise.

Depth is z in the camera's axes, in scene units, `inf` where nothing is known or nothing is there (sky). Zero and below
in a capture's map say that nothing was measured; `filled_depth` fills such places.
"""

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.scene.cameras import Camera, same_shape
from hydroviews.scene.images import Image, read_pixels
from hydroviews.scene.scenes import Points, View, wrong_size

Depth = NDArray[np.float32]  # [H, W]

FOLDER = "depth"  # beside a capture's images and beside a built scene's clean views
CHANNEL = "Z"
ENDS = (".exr", ".png", "_depth.exr", "_depth.png", ".depth.exr", ".depth.png")  # of a map's name
MILLIMETRES = 1000  # in a scene unit, for maps of 16 bits: sensors have them so, beside cameras in metres
HORIZON = 1e9  # renderers write about this number for sky
CELLS = 48  # of the grid that sparse points are gathered on, along the longer side
NEIGHBOURS = 12  # nearest points that give a cell its depth
NEAREST_SHARE = 0.25  # of the neighbours' weight that lies in front of the depth taken: points show through surfaces
GUIDED = 3  # cells around a pixel that its guided depth is drawn from
EDGE = 0.03  # encoded contrast that counts as an edge


def view_depth(view: View, points: Points, guide: Image | None = None) -> Depth:
    """Depth [H, W] of a view at its camera's size.

    Read from the map in `depth` beside the folder of the view's picture (see `depth_path`), if it is there. Otherwise
    gathered from the sparse points, which is coarse: within some per cent where surfaces have points, without thin
    objects, and extrapolated from the nearest points elsewhere. Without a point in front of the camera all is `inf`.

    Args:
        view: at its built size.
        points: of its scene.
        guide: the view's picture [H, W, 3]; depth from points is smoothed, but less over the picture's edges.

    Raises:
        InputError: an unreadable depth map, or one that changed since it was listed.
    """
    path = depth_path(view)
    if path.is_file():
        return fitted_depth(view.known(path), view.camera)
    return sparse_depth(view.camera, points.positions, guide)


def depth_path(view: View) -> Path:
    """Where the view's depth map lies if it has one: `depth/<name>.exr`, or under one of the other usual names.

    The name may be the view's, or the photograph's with or without its suffix; what follows is one of ENDS.
    """
    folder = view.path.parent.parent / FOLDER
    names = dict.fromkeys((view.name, view.path.stem, view.path.name)) if folder.is_dir() else ()
    usual = (folder / f"{name}{end}" for name in names for end in ENDS)
    return next((path for path in usual if path.is_file()), folder / f"{view.name}.exr")


def read_depth(path: Path) -> Depth:
    """Read a depth map; values beyond HORIZON, zero and below, or not a number become `inf`.

    Raises:
        InputError: see `stored_depth`.
    """
    depth = stored_depth(path)
    return np.where((depth > 0) & (depth < HORIZON), depth, np.float32(np.inf))


def stored_depth(path: Path) -> Depth:
    """A depth map as the file has it: the channel Z of an EXR, or a PNG of 16 bits in millimetres, as metres.

    Raises:
        InputError: missing, neither of these, or an EXR without a channel Z.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such depth map")
    if path.suffix.lower() == ".png":
        pixels = read_pixels(path, "a depth map")
        if pixels.dtype != np.uint16 or pixels.ndim != 2:
            kind = f"{pixels.dtype} of shape {pixels.shape}"
            raise InputError(f"{path}: not a depth map", found=kind, expected="16 bits grey, in millimetres, or an EXR")
        return np.asarray(pixels / np.float32(MILLIMETRES), np.float32)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:  # the library raises RuntimeError, TypeError or its own types by version
        raise InputError(f"{path}: not a readable EXR", found=error, fix="write the depth map again") from error
    if CHANNEL not in channels:
        raise InputError(f"{path}: no depth in it", found=f"channels {', '.join(channels)}", expected=CHANNEL)
    return np.asarray(channels[CHANNEL], np.float32)


def write_depth(path: Path, depth: NDArray) -> None:
    """Write [H, W], scene units, `inf` for sky, as a float32 EXR with the one channel Z.

    Raises:
        InputError: the disk is full.
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with replacing(path) as temporary:
        OpenEXR.File(header, {CHANNEL: np.ascontiguousarray(depth, np.float32)}).write(str(temporary))


def fitted_depth(path: Path, camera: Camera) -> Depth:
    """A depth map [H, W] of a camera's view at its size.

    Raises:
        InputError: unreadable, or of another shape than the view.
    """
    depth = _resized_to(camera, stored_depth(path), path)
    return np.where((depth > 0) & (depth < HORIZON), depth, np.float32(np.inf))


def filled_depth(path: Path, camera: Camera, points: Points) -> Depth:
    """`fitted_depth` of a capture's map, with depth from the points where it has none: at zero, below, not a number.

    Raises:
        InputError: unreadable, or of another shape than the view.
    """
    depth = _resized_to(camera, stored_depth(path), path)
    holes = ~(depth > 0)
    known = np.where(depth < HORIZON, depth, np.float32(np.inf))
    return np.where(holes, sparse_depth(camera, points.positions), known) if holes.any() else known


def _resized_to(camera: Camera, depth: Depth, path: Path) -> Depth:
    found, expected = (depth.shape[1], depth.shape[0]), (camera.width, camera.height)
    if not same_shape(found, expected):
        raise wrong_size(path, found, expected)
    return resized_depth(depth, *expected)


def resized_depth(depth: NDArray, width: int, height: int) -> Depth:
    """The depth under each new pixel's centre. An average would invent surfaces between near and far."""
    old_height, old_width = depth.shape
    rows = ((np.arange(height) + 0.5) * old_height / height).astype(int)
    columns = ((np.arange(width) + 0.5) * old_width / width).astype(int)
    return np.ascontiguousarray(depth[np.ix_(rows, columns)], np.float32)


def ray_distance(camera: Camera, depth: Depth) -> NDArray[np.float64]:
    """Distance [H, W] from the camera's centre to what lies at a depth [H, W], along the ray of each pixel."""
    x, y = camera.slopes
    return np.asarray(depth * np.sqrt(1 + x**2 + y[:, None] ** 2))


def sparse_depth(camera: Camera, positions: NDArray, guide: Image | None = None) -> Depth:
    """A coarse depth map [H, W] from scene points [N, 3].

    Every cell of a grid takes a low weighted quantile of its nearest points' depths, which leaves out most points
    that lie behind the visible surface; cells are joined linearly in 1 / depth, as planes are in a picture. With a
    guide [H, W, 3], the same is smoothed by a guided filter (He, Sun and Tang 2010).
    """
    from scipy.spatial import cKDTree

    pixels, depth = camera.project(positions)
    seen = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels <= (camera.width, camera.height)).all(axis=1)
    pixels, depth = pixels[seen], depth[seen]
    if len(depth) == 0:
        return np.full((camera.height, camera.width), np.inf, np.float32)
    cell = max(camera.width, camera.height) / min(CELLS, max(camera.width, camera.height))
    columns, rows = (max(1, round(side / cell)) for side in (camera.width, camera.height))
    x, y = ((np.arange(n) + 0.5) * side / n for n, side in ((columns, camera.width), (rows, camera.height)))
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    tree = cKDTree(pixels, balanced_tree=False, compact_nodes=False)  # built in half the time, and asked only once
    distance, index = tree.query(centres, k=list(range(1, min(NEIGHBOURS, len(depth)) + 1)))
    inverse = 1 / _low_quantile(depth[index], 1 / (distance + cell) ** 2)
    grid = inverse.reshape(rows, columns).astype(np.float32)
    smooth = cv2.resize(grid, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR)
    if guide is not None:
        limits = float(smooth.min()), float(smooth.max())
        # Grey, because OpenCV's filter sees no edges between greys in a colour guide.
        grey = cv2.cvtColor(np.asarray(guide, np.float32), cv2.COLOR_RGB2GRAY)
        filtered = cv2.ximgproc.guidedFilter(grey, smooth, round(GUIDED * cell), EDGE**2)
        smooth = np.clip(filtered, *limits)
    return np.asarray(1 / smooth, np.float32)


def _low_quantile(values: NDArray, weights: NDArray) -> NDArray:
    """The value of each row [N, K] below which NEAREST_SHARE of its weight lies: [N]."""
    order = np.argsort(values, axis=1)
    values, weights = np.take_along_axis(values, order, 1), np.take_along_axis(weights, order, 1)
    share = np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True)
    at = (share >= NEAREST_SHARE).argmax(axis=1)
    return np.asarray(values[np.arange(len(values)), at])
