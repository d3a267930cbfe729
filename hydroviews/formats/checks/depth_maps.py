"""Depth maps against points: a map has the depth of the points that its view shows.

Rain in space, haze and night are drawn from these maps, so that a wrong map is a wrong ground truth.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.formats.checks.samples import Sample, in_front, places
from hydroviews.formats.photographs import some
from hydroviews.scene.depth import CHANNEL, ENDS, FOLDER, HORIZON, depth_path, stored_depth
from hydroviews.scene.images import SUFFIXES
from hydroviews.scene.point_colours import evenly
from hydroviews.scene.scenes import Scene, View

MAPS, BUDGET = 4, 4e6  # that are read at most, and their pixels in all; one at least
FEWEST = 20  # points that tell anything
NEAR, SPREAD = 1.25, 0.2  # factor of map over point, and spread of its logarithm, of maps that fit
INVERSE, UNRELATED = -0.5, 0.3  # correlations of the logarithms: of disparity, and of maps of something else
MEASURED = 0.02  # share of a map below which hardly anything in it is depth
WELL_KNOWN = {1e3: "millimetres beside metres", 1e2: "centimetres beside metres", 1e-3: "metres beside millimetres"}


def depth_maps(scene: Scene, sample: Sample) -> list[str]:
    """Sentences on depth maps that are not read, and on what is missing in those that are.

    Raises:
        InputError: the maps contradict the points.
    """
    views = [view for view in scene.own_views if depth_path(view).is_file()]
    notes = unread_maps(scene.views, {depth_path(view) for view in views})
    if not views:
        return notes
    stored = [(views[i], stored_depth(depth_path(views[i]))) for i in evenly(len(views), _affordable(views[0]))]
    pairs = [_pairs(view, depth, sample) for view, depth in stored if view.lens is None]
    negative = np.mean([(depth < 0).mean() for _, depth in stored])
    measured = np.mean([(depth > 0).mean() for _, depth in stored])
    folder = depth_path(views[0]).parent
    if measured < MEASURED:
        found = "values below 0, as OpenGL's z has them" if negative > MEASURED else "hardly any value above 0"
        raise _contradiction(folder, "without depth", found)
    ratio, spread, related = _relation(pairs)
    if ratio is not None and not (1 / NEAR < ratio < NEAR and spread < SPREAD):
        _refuse(folder, pairs, ratio, spread, related)
    if measured < 1 - MEASURED:
        share = f"{1 - measured:.0%} of the depth maps"
        notes.append(f"{folder}: nothing was measured in {share}; depth is taken from the points there")
    return notes


def unread_maps(views: Sequence[View], read: set[Path]) -> list[str]:
    """A sentence on files in folders of depth maps that are read for no view."""
    left = []
    for folder in {view.path.parent.parent / FOLDER for view in views}:
        files = [Path(entry.path) for entry in os.scandir(folder) if entry.is_file()] if folder.is_dir() else []
        kinds = (".exr", ".npy", ".pfm", ".npz", *SUFFIXES)
        left += sorted(path for path in set(files) - read if path.suffix.lower() in kinds)
    if not left:
        return []
    expected = f"EXR with the channel {CHANNEL}, or PNG of 16 bits in millimetres, called {views[0].name}{ENDS[0]}"
    names = some([one.name for one in left])
    return [f"{left[0].parent}: {len(left)} files are not read ({names}); expected {expected}"]


def _affordable(view: View) -> int:
    return int(min(MAPS, max(1, BUDGET // (view.camera.width * view.camera.height))))


def _pairs(view: View, depth: NDArray, sample: Sample) -> tuple[NDArray, NDArray, NDArray]:
    """Depths of points that a view shows, of the map there, and of the map upside down."""
    place, of_points = places(view, sample.positions)
    shown = in_front(place, of_points)
    rows, columns = (place[shown, ::-1] * depth.shape).astype(int).T
    return of_points[shown], depth[rows, columns], depth[::-1][rows, columns]


def _relation(pairs: Sequence[tuple[NDArray, ...]], which: int = 1) -> tuple[float | None, float, float]:
    """Map over point in the middle, the spread of its logarithm, and the correlation of both logarithms."""
    points = np.concatenate([pair[0] for pair in pairs] or [np.zeros(0)])
    maps = np.concatenate([pair[which] for pair in pairs] or [np.zeros(0)])
    known = (maps > 0) & (maps < HORIZON)
    if known.sum() < FEWEST:
        return None, 0.0, 0.0
    points, maps = np.log(points[known]), np.log(maps[known])
    middle = float(np.median(maps - points))
    spread = float(1.4826 * np.median(np.abs(maps - points - middle)))
    varied = min(points.std(), maps.std()) > 1e-6
    return float(np.exp(middle)), spread, float(np.corrcoef(points, maps)[0, 1]) if varied else 0.0


def _refuse(folder: Path, pairs: Sequence[tuple[NDArray, ...]], ratio: float, spread: float, related: float) -> None:
    """Refuse maps that do not fit, with what they are as it seems; what fits roughly passes."""
    turned, turned_spread, _ = _relation(pairs, which=2)
    if turned is not None and 1 / NEAR < turned < NEAR and turned_spread < SPREAD:
        raise _contradiction(folder, "not that of the points", "maps upside down, as OpenGL reads buffers")
    if related < INVERSE:
        raise _contradiction(folder, "far is near in them", "1 / depth, which is disparity, as it seems")
    if spread < SPREAD:
        kind = next((f": {says}?" for factor, says in WELL_KNOWN.items() if 1 / NEAR < ratio / factor < NEAR), "")
        times = f"{ratio:,.0f}" if ratio > 10 else f"{ratio:.3g}"
        raise _contradiction(folder, f"{times} times as far as the points", f"another unit than the cameras'{kind}")
    if related < UNRELATED:
        raise _contradiction(folder, "not that of the points", "maps of other views, or of another scene, as it seems")


def _contradiction(folder: Path, what: str, found: str) -> InputError:
    return InputError(
        f"{folder}: the depth maps contradict the capture's points: {what}",
        found=found,
        expected="depth along the viewing axis, in the unit of the cameras; 0 where nothing was measured",
        fix="write the maps so, or take the folder out of the capture: depth is then taken from the points",
    )
