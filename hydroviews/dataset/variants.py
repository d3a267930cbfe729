"""Opens what `build` wrote: the clean views of a scene, or one of its rainy variants.

Of a scene that a manifest lists, only what is listed is read, and only with the bytes that are listed: cameras,
points and split when it is opened, pictures, masks and depth when a view is asked for them. A folder that no manifest
lists, or a scene that is still being built, is read as it lies there.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import HELD_BACK, listed_files, scene_entry
from hydroviews.errors import InputError
from hydroviews.files.known_bytes import require_bytes
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.colmap import read_colmap, reliable
from hydroviews.formats.colmap_format import RegisteredImage, read_cameras, read_images, read_points
from hydroviews.formats.photographs import SPLIT, read_split, some
from hydroviews.formats.writers import MODEL
from hydroviews.scene.depth import depth_path
from hydroviews.scene.lenses import Lens
from hydroviews.scene.masks import MASKS, mask_name
from hydroviews.scene.scenes import Scene, View, make_scene


def open_clean(folder: Path) -> Scene:
    """The clean views of a built scene, with its split.

    Raises:
        InputError: there are none, since it rained when the scene was captured; it was not built; or cameras, points or
            split are not what the manifest says, or a picture is not in it.
    """
    if is_captured(folder) and not has_clean(folder):
        raise InputError(
            f"{folder}: taken in rain, there are no clean views",
            fix=f"use what needs none, such as METHOD=3dgs, and open its photographs as the variant {CAPTURED}",
        )
    return _open(folder, folder, CLEAN)


def open_variant(folder: Path, pattern: str) -> Scene:
    """The rainy views of a built scene; cameras, points, split and masks are the clean ones.

    Raises:
        InputError: see `open_clean`.
    """
    return _open(folder, folder / pattern, "images")


def is_captured(folder: Path) -> bool:
    """Whether a built scene was captured in rain, so that CAPTURED is its one variant."""
    return (folder / CAPTURED).is_dir()


def has_clean(folder: Path) -> bool:
    """Whether a built scene has clean views, all of its own or those that a capture in rain had beside them."""
    return (folder / CLEAN).is_dir()


def shown_views(folder: Path, images: str, scene: Scene) -> tuple[View, ...]:
    """The views that must have a picture in a folder of a built scene, `clean` or a variant's.

    All of them; but where rainy and clean photographs were taken, there are only views to train on sure to be rainy,
    and only held-out views sure to be clean.
    """
    if not (is_captured(folder) and has_clean(folder)):
        return scene.views
    return scene.test_views if images == CLEAN else scene.train_views


def has_ceiling(folder: Path) -> bool:
    """Whether all training views of a built scene are there as clean views."""
    return has_clean(folder) and all(view.path.is_file() for view in open_clean(folder).train_views)


def _open(scene: Path, project: Path, images: str) -> Scene:
    if not (project / images).is_dir():
        raise InputError(f"{project / images}: no such views", fix="build the scene with this pattern first")
    entry = scene_entry(scene)
    found = _open_listed(scene, project / images, entry) if entry else read_colmap(project, scene.name, images)
    return replace(found, captured_rainy=project.name == CAPTURED)


def _open_listed(scene: Path, images: Path, entry: Mapping[str, Any]) -> Scene:
    """The scene with the pictures in a folder, from listed files alone."""
    listed, model = listed_files(scene, entry), scene / MODEL
    used = [scene / SPLIT, *(path for path in listed if path.parent == model)]
    for path in used:
        require_bytes(_must_be_listed(path, listed), listed[path])
    lenses = read_cameras(model)
    registered = read_images(model)
    strange = {image.camera_id for image in registered} - set(lenses)
    if strange:
        raise InputError(f"{model}: images.bin names cameras that cameras.bin lacks", found=f"camera {min(strange)}")
    views = [_listed_view(scene, images, image, lenses[image.camera_id], listed) for image in registered]
    found = make_scene(scene.name, views, reliable(read_points(model)), read_split(scene))
    shown = shown_views(scene, images.relative_to(scene).as_posix(), found)
    absent = [view.name for view in shown if view.path not in listed and view.name not in entry.get(HELD_BACK, ())]
    if absent:
        raise InputError(
            f"{images}: views that are not in the manifest", found=some(absent), fix="build the scene with this pattern"
        )
    return found


def _must_be_listed(path: Path, listed: Mapping[Path, str]) -> Path:
    if path not in listed:
        raise InputError(f"{path}: not in the manifest", fix="build the scene again")
    return path


def _listed_view(scene: Path, images: Path, image: RegisteredImage, lens: Lens, listed: Mapping[Path, str]) -> View:
    path, mask = images / image.name, scene / MASKS / mask_name(image.name)
    camera = lens.pinhole((lens.width, lens.height)).camera(image.world_to_camera)
    view = View(PurePosixPath(image.name).stem, camera, path, mask=mask if mask in listed else None, listed=listed)
    if depth_path(view).is_file():
        _must_be_listed(depth_path(view), listed)
    return view
