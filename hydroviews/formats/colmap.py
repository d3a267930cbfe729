"""COLMAP projects: a sparse model, binary or text, with any camera model, beside a folder of photographs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hydroviews.errors import InputError
from hydroviews.formats.colmap_format import (
    FORMS,
    RegisteredImage,
    SparsePoints,
    model_suffix,
    read_cameras,
    read_images,
    read_points,
)
from hydroviews.formats.geometry import misplaced_note
from hydroviews.formats.photographs import (
    Match,
    all_files,
    image_folder,
    make_view,
    mask_beside,
    match_files,
    photographs_below,
    read_split,
    view_names,
)
from hydroviews.scene.point_colours import evenly
from hydroviews.scene.scenes import Observed, Points, Scene, View, make_scene

MODEL_FOLDERS = ("sparse", "colmap/sparse")

# Points worth starting from, unless too few are left.
MAX_ERROR = 2.0  # pixels
MIN_TRACK = 3  # views
ENOUGH_POINTS = 1000

OBSERVED = 12  # images whose keypoints are compared with the points


def find_models(folder: Path) -> list[Path]:
    """Folders with a COLMAP model: `folder` itself, `sparse`, `sparse/*`, and the same below `colmap`."""
    return [path for path in _candidates(folder) if model_suffix(path)]


def _candidates(folder: Path) -> list[Path]:
    candidates = [folder]
    for name in MODEL_FOLDERS:
        if (folder / name).is_dir():
            candidates += [folder / name, *sorted(p for p in (folder / name).glob("[!.]*") if p.is_dir())]
    return candidates


def refuse_mixed(folder: Path) -> None:
    """Refuse a model of one binary and one text file, which need not belong together.

    Raises:
        InputError: there is one, and no whole model.
    """
    for path in _candidates(folder):
        files = [path / f"{kind}{form}" for kind in ("cameras", "images") for form in FORMS]
        files = [file for file in files if file.is_file()]
        if {file.stem for file in files} == {"cameras", "images"}:
            raise InputError(
                f"{path}: a model of which one file is binary and one is text",
                found=" and ".join(file.name for file in files),
                expected="cameras.bin and images.bin, or cameras.txt and images.txt",
                fix="copy both files from the same model",
            )


def read_colmap(folder: Path, name: str, images: str | None = None, match: Match = match_files) -> Scene:
    """Read the largest model of a COLMAP project.

    Args:
        folder: the project, with `sparse/0` or the like and the photographs.
        name: of the scene.
        images: folder of the photographs inside `folder`, where it is not one of the usual ones.
        match: finds the photographs.

    Raises:
        InputError: a damaged model, no registered image, images that are missing or of another shape.
    """
    model, registered, others = _largest_model(folder)
    photographs = image_folder(folder, images)
    files = all_files(model, photographs, [image.name for image in registered], match)
    masks = [mask_beside(folder, photographs, file) for file in files]
    views = _views(model, registered, files, masks)
    total = max(len(photographs_below(photographs)), len(views))
    notes = [f"cameras from {model.relative_to(folder)}: {len(views)} of {total} images registered", *others]
    ordered = sorted(views, key=lambda view: view.name)
    notes += misplaced_note([view.name for view in ordered], [view.camera.centre for view in ordered])
    points = read_points(model)
    scene = make_scene(name, views, reliable(points), read_split(folder), notes)
    return replace(scene, observed=_observed(model, registered, [view.name for view in views], points))


def _observed(
    model: Path, images: Sequence[RegisteredImage], names: Sequence[str], points: SparsePoints
) -> dict[str, Observed]:
    """The points of a few images, evenly spread, where their keypoints are."""
    lenses, found = read_cameras(model), {}
    for i in evenly(len(images), OBSERVED):
        try:
            pixels, ids = images[i].keypoints()
        except ValueError as error:
            raise InputError(
                f"{model}: {images[i].name}: not keypoints", found=error, fix="write the model again, or copy it again"
            ) from error
        at = np.minimum(np.searchsorted(points.ids, ids), len(points.ids) - 1)
        known = points.ids[at] == ids if len(points.ids) else np.zeros(len(ids), bool)
        lens, at = lenses[images[i].camera_id], at[known]
        places = pixels[known] / (lens.width, lens.height)
        found[names[i]] = Observed(places, points.positions[at], points.colours[at])
    return found


def _largest_model(folder: Path) -> tuple[Path, list[RegisteredImage], list[str]]:
    """The model with most images, its images, and a note if there were others."""
    models = [(path, read_images(path)) for path in find_models(folder)]
    if not models:
        raise InputError(f"{folder}: no COLMAP model", expected="cameras.bin and images.bin, or .txt, in sparse/0")
    path, images = max(models, key=lambda model: len(model[1]))
    if not images:
        raise InputError(
            f"{path}: no registered image",
            fix="estimate the poses again: python -m hydroviews poses IMAGES",
        )
    left = [f"{other.relative_to(folder)} ({len(rest)} images)" for other, rest in models if other != path]
    return path, images, [f"the largest of several models; not used: {', '.join(left)}"] if left else []


def _views(
    model: Path, images: Sequence[RegisteredImage], files: Sequence[Path], masks: Sequence[Path | None]
) -> list[View]:
    lenses = read_cameras(model)
    absent = sorted({image.camera_id for image in images} - set(lenses))
    if absent:
        raise InputError(
            f"{model}: images.* names cameras that cameras.* lacks",
            found=f"camera {absent[0]}",
            expected=f"one of {sorted(lenses)}",
            fix="copy both files from the same model",
        )
    names = view_names([image.name for image in images])
    return [
        make_view(name, file, lenses[image.camera_id], image.world_to_camera, mask)
        for name, file, image, mask in zip(names, files, images, masks, strict=True)
    ]


def reliable(points: SparsePoints) -> Points:
    """Points seen by MIN_TRACK views within MAX_ERROR; all of them where too few are."""
    good = (points.errors < MAX_ERROR) & (points.track_lengths >= MIN_TRACK)
    if good.sum() < min(ENOUGH_POINTS, len(good) / 2):
        good[:] = True
    return Points(points.positions[good], points.colours[good])
