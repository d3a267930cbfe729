"""nerfstudio, instant-ngp and Blender captures: `transforms.json` with OpenGL camera-to-world matrices."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.formats.geometry import OPENGL_TO_OPENCV, inverse, misplaced_note, rigid_pose
from hydroviews.formats.photographs import (
    Match,
    below_first,
    make_view,
    match_files,
    other_images,
    posix_name,
    read_split,
    some,
    stem,
    view_names,
)
from hydroviews.formats.points.ply import read_ply
from hydroviews.scene.checks import check_file_name
from hydroviews.scene.images import image_size
from hydroviews.scene.lenses import Lens, named_lens
from hydroviews.scene.masks import MASKS, find_mask
from hydroviews.scene.scenes import Points, Scene, View, make_scene, no_points

CAMERA_FILE = "transforms.json"
PARTS = ("train", "val", "test")  # of captures with a file for each: transforms_train.json

PERSPECTIVE = ("", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
FISHEYE = ("OPENCV_FISHEYE",)


def read_nerfstudio(folder: Path, name: str, match: Match = match_files) -> Scene:
    """Read `transforms.json`; frames whose image is missing are left out and noted.

    Intrinsics may be shared or a frame's own (`fl_x, fl_y, cx, cy, w, h, k1..k4, p1, p2`, or `camera_angle_x`).
    `applied_transform` needs no handling: poses and points are both stored after it.
    Black pixels of a frame's `mask_path` are hidden. `match` finds the photographs.

    Raises:
        InputError: not such a file, no frame with an image, or an invalid pose or intrinsic.
    """
    path = folder / CAMERA_FILE
    content = _content(path)
    return _scene(path, name, content, content["frames"], match)


def part_files(folder: Path) -> dict[str, Path]:
    """The files of a Blender capture that has one for each part of its split; empty where `transforms.json` is one."""
    if (folder / CAMERA_FILE).is_file():
        return {}
    found = {part: folder / f"transforms_{part}.json" for part in PARTS}
    return {part: path for part, path in found.items() if path.is_file()}


def read_parts(folder: Path, name: str, match: Match = match_files) -> Scene:
    """Read `transforms_train.json` and the like as one capture.

    Raises:
        InputError: see `read_nerfstudio`.
    """
    frames = []
    for path in part_files(folder).values():
        content = _content(path)
        shared = {key: value for key, value in content.items() if key != "frames"}
        frames += [{**shared, **frame} for frame in content["frames"]]
    first = next(iter(part_files(folder).values()))
    return _scene(first, name, {}, frames, match)


def part_names(folder: Path) -> dict[str, list[str]]:
    """The files of the frames of each part of a capture's split, as `transforms.json` or one file for each part has it.

    Raises:
        InputError: a list of the file is none of names.
    """
    parts = part_files(folder)
    if parts:
        return {part: [str(frame["file_path"]) for frame in _content(path)["frames"]] for part, path in parts.items()}
    path = folder / CAMERA_FILE
    content = _content(path) if path.is_file() else {}
    listed = {part: content[f"{part}_filenames"] for part in PARTS if f"{part}_filenames" in content}
    if not all(isinstance(names, list) and all(isinstance(name, str) for name in names) for names in listed.values()):
        raise InputError(f"{path}: a part of its split is no list of names", expected='"train_filenames": [names]')
    return listed


def _content(path: Path) -> dict[str, Any]:
    """A camera file whose frames are a list of objects."""
    content = read_json(path)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise InputError(f"{path}: no frames", expected='{"frames": [{"file_path", "transform_matrix"}, ...]}')
    return dict(content)


def _scene(
    path: Path, name: str, content: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], match: Match
) -> Scene:
    """The scene of a camera file's frames, which may have intrinsics in common."""
    folder = path.parent
    names = [_file_name(path, f"frame {i}", frame) for i, frame in enumerate(frames)]
    files = match(folder, names)
    if not any(files):
        raise other_images(path, folder, names)
    counts = Counter(PurePosixPath(stem(frame_name)).name for frame_name in names)
    views = [
        _view(path, view_name, file, {**content, **frame}, _mask(folder, frame, file, frame_name, counts))
        for view_name, frame_name, file, frame in zip(view_names(names), names, files, frames, strict=True)
        if file
    ]
    points, notes = _points(folder, content), []
    missing = [frame_name for frame_name, file in zip(names, files, strict=True) if not file]
    notes.append(f"cameras from {path.name}: {len(views)} of {len(names)} frames have an image")
    if missing:
        notes.append(f"no image for {some(missing)}")
    if not len(points):
        notes.append("the capture has no points")
    ordered = sorted(views, key=lambda view: view.name)
    notes += misplaced_note([view.name for view in ordered], [view.camera.centre for view in ordered])
    return make_scene(name, views, points, read_split(folder), notes)


def _file_name(path: Path, which: str, frame: Mapping[str, Any]) -> str:
    if not isinstance(frame.get("file_path"), str) or "transform_matrix" not in frame:
        raise InputError(f"{path}: {which} is not complete", expected="file_path and transform_matrix")
    return str(Path(check_file_name(f"{path}: {which}", posix_name(frame["file_path"]))))  # without a leading ./


def _mask(folder: Path, frame: Mapping[str, Any], file: Path, name: str, counts: Mapping[str, int]) -> Path | None:
    """The mask a frame names, else the one in `masks` of its file's name, or of the name that the frame has for it.

    A name without its folders counts where it is one frame's alone, by the `counts` of names without suffix.
    """
    if not frame.get("mask_path"):
        alone = counts[PurePosixPath(stem(name)).name] == 1
        both = [PurePosixPath(file.relative_to(folder)), PurePosixPath(name)]
        images = [str(way) for one in both for way in (one, below_first(one), *([one.name] if alone else []))]
        return next((mask for image in images if (mask := find_mask(folder / MASKS, image))), None)
    path = folder / check_file_name(f"{folder / CAMERA_FILE}: mask_path", posix_name(frame["mask_path"]))
    if not path.is_file():
        raise InputError(f"{path}: no such mask", fix="copy it back, or remove mask_path from the frame")
    return path


def _view(path: Path, name: str, file: Path, frame: Mapping[str, Any], mask: Path | None) -> View:
    camera_to_world = rigid_pose(frame["transform_matrix"], f"{path}: {name}") @ OPENGL_TO_OPENCV
    return make_view(name, file, _lens(path, name, file, frame), inverse(camera_to_world), mask)


def _lens(path: Path, name: str, file: Path, frame: Mapping[str, Any]) -> Lens:
    """The lens of a frame; what is not given is taken from the image and from the field of view."""
    where = f"{path}: {name}"
    width, height = image_size(file) if not {"w", "h"} <= frame.keys() else (0, 0)
    width, height = round(_number(where, frame, "w", width)), round(_number(where, frame, "h", height))
    given = [_focal(where, frame, "x", width), _focal(where, frame, "y", height)]
    focal = [length for length in given if length is not None]
    if not focal:
        raise InputError(f"{where}: no focal length", expected="fl_x or camera_angle_x")
    centre = _number(where, frame, "cx", width / 2), _number(where, frame, "cy", height / 2)
    model, distortion = _distortion(where, frame)
    return named_lens(where, model, width, height, (focal[0], focal[-1], *centre, *distortion))


def _focal(where: str, frame: Mapping[str, Any], axis: str, extent: int) -> float | None:
    """Focal length in pixels along an axis, from itself or from the field of view in radians."""
    if f"fl_{axis}" in frame:
        return _number(where, frame, f"fl_{axis}", 0)
    if f"camera_angle_{axis}" in frame:
        angle = _number(where, frame, f"camera_angle_{axis}", 0)
        if not 0 < angle < math.pi:
            raise InputError(f"{where}: impossible camera_angle_{axis}", found=angle, expected="0 to pi, in radians")
        return extent / 2 / math.tan(angle / 2)
    return None


def _distortion(where: str, frame: Mapping[str, Any]) -> tuple[str, Sequence[float]]:
    """COLMAP's camera model and the parameters after fx, fy, cx, cy."""
    k1, k2, k3, k4, p1, p2 = (_number(where, frame, key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    declared = str(frame.get("camera_model", "")).upper()
    if declared in FISHEYE or frame.get("is_fisheye"):
        return "OPENCV_FISHEYE", (k1, k2, k3, k4)
    if declared not in PERSPECTIVE:
        raise InputError(
            f"{where}: camera_model {declared} is not supported",
            expected=f"one of {', '.join((*PERSPECTIVE[1:], *FISHEYE))}",
            fix="undistort the images to a pinhole camera first",
        )
    if k4:
        raise InputError(
            f"{where}: a fourth radial coefficient on a perspective camera",
            found=f"k4 {k4}",
            expected="k1, k2, k3, p1, p2, or camera_model OPENCV_FISHEYE",
        )
    if k3:
        return "FULL_OPENCV", (k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)
    return ("OPENCV", (k1, k2, p1, p2)) if any((k1, k2, p1, p2)) else ("PINHOLE", ())


def _number(where: str, frame: Mapping[str, Any], key: str, default: float) -> float:
    value = frame.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{where}: {key} is not a number", found=value)
    return float(value)


def _points(folder: Path, content: Mapping[str, Any]) -> Points:
    """The point cloud of `ply_file_path`, grey where it has no colours; none where none is named."""
    if not content.get("ply_file_path"):
        return no_points()
    name = posix_name(content["ply_file_path"])
    return read_ply(folder / check_file_name(f"{folder / CAMERA_FILE}: ply_file_path", name))
