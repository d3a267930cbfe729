"""The cameras of the track rainy-poses: estimated from the photographs that a method learns from, once for all methods.

<results>/<profile>/rainy-poses/<scene>/<pattern>/seed-<n>/
    settings.json            the data and the seed
    photographs/, capture/   what `estimate_poses` reads and leaves
    sparse/0, split.json     the cameras in the world of the clean ones, with the held-out views
    errors.json              what `CameraErrors` has, written last
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.captures.sfm.mapping import TooFewRegistered
from hydroviews.captures.sfm.poses import estimate_poses
from hydroviews.captures.sfm.sources import link_photographs
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.settings_guard import claim_folder
from hydroviews.formats.colmap import reliable
from hydroviews.formats.colmap_format import read_cameras, read_images, read_points
from hydroviews.formats.photographs import SPLIT, read_split
from hydroviews.formats.writers import MODEL, write_colmap
from hydroviews.scene.alignment import NEEDED, Similarity
from hydroviews.scene.camera_errors import CameraErrors, compare_cameras
from hydroviews.scene.cameras import Camera
from hydroviews.scene.masks import MASKS, mask_name
from hydroviews.scene.scenes import Points, Scene, Split, View, every_third

SETTINGS, PHOTOGRAPHS, CAPTURE, ERRORS = "settings.json", "photographs", "capture", "errors.json"
CAMERA_MODEL = "SIMPLE_PINHOLE"  # what built pictures are: undistorted, about their middle
ENOUGH = 0.5  # share of the photographs that must register for a run to be more than chance


@dataclass(frozen=True)
class Estimate:
    """What there is of estimated cameras."""

    errors: CameraErrors
    reason: str  # why nothing can be trained on them; "" if it can


def estimate_cameras(folder: Path, scene: Scene, seed: int, data_sha256: str, rainy: bool) -> Estimate:
    """Estimate cameras of a scene's training photographs into a folder, unless they are there; resumes.

    While another process is at it, wait: all methods learn from the same cameras.

    Args:
        folder: for one scene, pattern and seed.
        scene: the photographs, with the true cameras.
        seed: of `estimate_poses`.
        data_sha256: of the scene; cameras of other data are estimated anew.
        rainy: whether it rains in the photographs.
    """
    with locked(folder, BUSY):
        claim_folder(
            folder / SETTINGS,
            {"data_sha256": data_sha256, "seed": seed, "rainy": rainy},
            taken="holds cameras of other photographs",
            foreign="holds other files",
            fix="remove it",
            overwrite=True,
        )
        if not (folder / ERRORS).is_file():
            estimate = _estimate(folder, scene, seed, rainy)
            write_json(folder / ERRORS, {**dataclasses.asdict(estimate.errors), "reason": estimate.reason})
    return read_estimate(folder)


def read_estimate(folder: Path) -> Estimate:
    """What `estimate_cameras` has found.

    Raises:
        InputError: it has not ended.
    """
    if not (folder / ERRORS).is_file():
        raise InputError(f"{folder}: no estimated cameras", fix="evaluate the run again: it estimates them")
    said: dict[str, Any] = read_json(folder / ERRORS)
    return Estimate(CameraErrors(**{name: value for name, value in said.items() if name != "reason"}), said["reason"])


def with_cameras(scene: Scene, folder: Path) -> Scene:
    """The scene with estimated cameras and points, without the training views that were not registered.

    Raises:
        InputError: there are none, or too few to train on.
    """
    reason = read_estimate(folder).reason
    if reason:
        raise InputError(f"{folder}: no cameras to train on", found=reason)
    lenses, images = read_cameras(folder / MODEL), read_images(folder / MODEL)
    cameras = {Path(image.name).stem: _camera(lenses[image.camera_id], image.world_to_camera) for image in images}
    views = tuple(replace(view, camera=cameras[view.name]) for view in scene.views if view.name in cameras)
    split = read_split(folder)
    assert split is not None  # written before the errors
    return replace(scene, views=views, points=reliable(read_points(folder / MODEL)), split=split)


def _camera(lens: Any, world_to_camera: Any) -> Camera:
    return lens.pinhole((lens.width, lens.height)).camera(world_to_camera)


def _estimate(folder: Path, scene: Scene, seed: int, rainy: bool) -> Estimate:
    """Estimate, compare with the true cameras, and write those that a run gets."""
    names = {f"{i:05d}": view for i, view in enumerate(scene.train_views)}
    link_photographs(
        {f"{name}.png": view.known(view.path) for name, view in names.items()}, folder / PHOTOGRAPHS, turned=False
    )
    true = {view.name: view.camera.world_to_camera for view in scene.train_views}
    try:
        masks = _masks(folder, names)
        found = estimate_poses(
            folder / PHOTOGRAPHS, folder / CAPTURE, CAMERA_MODEL, seed=seed, masks=masks, rainy=rainy
        )
    except TooFewRegistered as error:
        return Estimate(replace(compare_cameras({}, true)[0], registered=error.registered), str(error).splitlines()[0])
    views = {names[view.name].name: view for view in found.views}
    errors, to_true = compare_cameras({name: view.camera.world_to_camera for name, view in views.items()}, true)
    needed = max(NEEDED, math.ceil(ENOUGH * len(true)))
    if len(views) < needed:
        return Estimate(errors, f"{len(views)} of {len(true)} photographs registered, fewer than {needed}")
    if to_true is None:
        return Estimate(errors, errors.unaligned)
    _write(folder, scene, found.points, views, to_true)
    return Estimate(errors, "")


def _write(folder: Path, scene: Scene, points: Points, views: Mapping[str, View], to_true: Similarity) -> None:
    """Write registered and held-out cameras, and the points, all in the true world.

    A held-out camera stays where it truly is. Its focal length is scaled as the others' were by being estimated, for
    the scene that is learned is stretched along the cameras' axes as much as they are wrong about it.
    """
    registered = tuple(
        replace(view, camera=_moved(views[view.name].camera, to_true))
        for view in scene.train_views
        if view.name in views
    )
    true = {view.name: view.camera for view in scene.train_views}
    longer = float(np.median([view.camera.fx / true[view.name].fx for view in registered]))
    held_out = tuple(replace(view, camera=_zoomed(view.camera, longer)) for view in scene.test_views)
    train = tuple(view.name for view in registered)
    split = Split(train, scene.split.test, every_third(train))
    points = replace(points, positions=to_true.points(points.positions))
    write_colmap(replace(scene, views=registered + held_out, points=points, split=split), folder / MODEL)
    write_json(folder / SPLIT, dataclasses.asdict(split))


def _moved(camera: Camera, to_true: Similarity) -> Camera:
    return replace(camera, world_to_camera=to_true.poses(camera.world_to_camera))


def _zoomed(camera: Camera, factor: float) -> Camera:
    return replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)


def _masks(folder: Path, names: Mapping[str, View]) -> Path | None:
    """A mask for every photograph, where any of them has one."""
    if not any(view.mask for view in names.values()):
        return None
    for name, view in names.items():
        view.write_mask(folder / MASKS / mask_name(f"{name}.png"))
    return folder / MASKS
