"""Incremental mapping by pycolmap: from verified matches to cameras and points; snapshots resume it."""

import logging
import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.captures.sfm import matching
from hydroviews.captures.sfm.room import DATABASE
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.full_disk import plain_full_disk
from hydroviews.files.temporary import temporary_beside
from hydroviews.formats.colmap_format import read_images
from hydroviews.formats.writers import check_whole
from hydroviews.scene.camera_errors import compare_cameras

logger = logging.getLogger(__name__)

MINIMUM = 3  # registered views that make a scene
# Degrees between the rays of the first pair: wide is stable, but captures from one side have none that wide.
# COLMAP halves each twice before it gives up.
FIRST_PAIR_ANGLES = (16.0, 4.0)
ENOUGH = 0.9  # share of photographs that must register before no other first pair is tried
POSE_ERROR = 3.0  # how many times as far off a point may be where a view is first registered
# Of photographs in rain, where pycolmap asks for 100 points, 30 and a quarter.
FIRST_PAIR_POINTS, VIEW_POINTS, VIEW_SHARE = 50, 15, 0.15
FEWEST_DEGREES = 1.5  # between the rays to a point, as in mapping
# Focal lengths in longer sides of a picture (136 and 6 degrees wide), and a distortion, outside of which a camera is
# wrong: photographs from places one behind the other leave the focal length open.
PLAUSIBLE_FOCALS, MOST_DISTORTION = (0.2, 10.0), 1.0
SNAPSHOT_EVERY = 10  # registered views between snapshots; an interruption may cost two of these intervals
# Agreement of two mappings below which chance decides: right cameras of development scenes have 0.93 and more.
REPEATABLE = 0.8
MAPPING = ".unfinished-mapping"  # with snapshots that an interrupted mapping resumes from


class TooFewRegistered(InputError):
    """Fewer photographs have got a camera than make a scene."""

    def __init__(self, images: Path, registered: int, photographs: int, advice: str) -> None:
        super().__init__(
            f"{images}: only {registered} of {photographs} photographs could be registered",
            expected=f"at least {MINIMUM}",
            fix=advice,
        )
        self.registered = registered


def mapping_options(seed: int) -> pycolmap.IncrementalPipelineOptions:
    """Whose outcome depends on the seed alone."""
    options = pycolmap.IncrementalPipelineOptions(min_model_size=MINIMUM, random_seed=seed)
    options.num_threads = 1  # with more, rounding differs from run to run, and now and then the model with it
    options.snapshot_frames_freq = SNAPSHOT_EVERY
    options.min_focal_length_ratio, options.max_focal_length_ratio = PLAUSIBLE_FOCALS
    options.max_extra_param = MOST_DISTORTION
    return options


def rainy_options(seed: int, error: float) -> pycolmap.IncrementalPipelineOptions:
    """For photographs in rain: fewer points for a view, which have to be nearer, in pixels, to where they are seen."""
    options = mapping_options(seed)
    mapper = options.mapper
    mapper.filter_max_reproj_error, mapper.abs_pose_max_error = error, POSE_ERROR * error
    mapper.init_min_num_inliers, mapper.abs_pose_min_num_inliers = FIRST_PAIR_POINTS, VIEW_POINTS
    mapper.abs_pose_min_inlier_ratio = VIEW_SHARE
    return options


def polished(model: pycolmap.Reconstruction, error: float) -> pycolmap.Reconstruction:
    """Adjust cameras and points again, so that what does not fit counts little (Cauchy), and leave it out.

    Args:
        model: stays as it is.
        error: pixels by which a point may be off.

    Returns:
        Another model of the same views; the one given where that would fall apart, as wrong ones do.
    """
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = error / 2
    options.ceres.solver_options.num_threads = 1  # as for mapping
    adjusted = pycolmap.Reconstruction(model)
    for limit in (error, error / 2):
        pycolmap.bundle_adjustment(adjusted, options)
        pycolmap.ObservationManager(adjusted).filter_all_points3D(limit, FEWEST_DEGREES)
    views = [image for image in adjusted.images.values() if image.has_pose]
    numbers = [*(camera.params for camera in adjusted.cameras.values()), *(v.cam_from_world().matrix() for v in views)]
    whole = all(np.isfinite(one).all() for one in numbers) and min(view.num_points3D for view in views) > 0
    return adjusted if whole else model


def settled(model: pycolmap.Reconstruction, error: float) -> pycolmap.Reconstruction:
    """Another model, adjusted a last time, of the views that are held by points.

    Args:
        model: stays as it is.
        error: pixels by which a point may be off.
    """
    model = polished(model, error)
    held = without_lost_views(model, error)
    return polished(held, error) if MINIMUM <= held.num_reg_images() < model.num_reg_images() else held


def without_lost_views(model: pycolmap.Reconstruction, error: float) -> pycolmap.Reconstruction:
    """Another model without the views that share no point with others, or whose camera is not plausible.

    No view of a camera that only turns is left.

    Args:
        model: stays as it is.
        error: pixels by which a point may be off.
    """
    held = pycolmap.Reconstruction(model)
    pycolmap.ObservationManager(held).filter_all_points3D(error, FEWEST_DEGREES)
    views = [view for view in held.images.values() if view.has_pose]
    lost = [view for view in views if not (view.num_points3D and is_plausible(held.cameras[view.camera_id]))]
    for view in lost:
        held.deregister_frame(view.frame_id)
    if lost:
        logger.warning("%d views share no point with others, or have no plausible camera, and are left out", len(lost))
    return held


def is_plausible(camera: pycolmap.Camera) -> bool:
    """True for intrinsics that photographs have. Wrong models may have focal lengths of a pixel."""
    return bool(np.isfinite(camera.params).all()) and not camera.has_bogus_params(*PLAUSIBLE_FOCALS, MOST_DISTORTION)


def map_photographs(
    out: Path,
    count: int,
    options: pycolmap.IncrementalPipelineOptions,
    advice: str,
    finish: Callable[[pycolmap.Reconstruction], pycolmap.Reconstruction] = lambda model: model,
) -> None:
    """Find cameras and points; the models go to `out/sparse` together, the largest first.

    Args:
        out: with `images` and the database of their matches.
        count: of the photographs.
        options: of the mapping; a first pair's angle is set here.
        advice: what to do if too few register.
        finish: makes the largest model better in the end.

    Raises:
        TooFewRegistered: fewer than three.
    """
    models = _largest_first(out, count, options)
    if _registered(models) >= MINIMUM:
        models[0] = finish(models[0])
    if _registered(models) < MINIMUM:
        raise TooFewRegistered(out / "images", _registered(models), count, advice)
    with plain_full_disk(out / "sparse"), temporary_beside(out / "sparse") as finished:
        for i, model in enumerate(models):
            (finished / str(i)).mkdir(parents=True)
            model.write_binary(finished / str(i))
            check_whole(finished / str(i))
        ownership.enter(out / "sparse", finished)
        os.replace(finished, out / "sparse")


def warn_of_chance(out: Path, count: int, options: pycolmap.IncrementalPipelineOptions) -> None:
    """Warn if another mapping finds other cameras than those in `out/sparse`: some are wrong then.

    Args:
        out, count: as for `map_photographs`.
        options: with another seed.
    """
    try:
        models = _largest_first(out, count, options)
    finally:  # nothing resumes it
        shutil.rmtree(out / MAPPING, ignore_errors=True)
    found, again = _poses(pycolmap.Reconstruction(out / "sparse" / "0")), _poses(models[0]) if models else {}
    both = {name: again[name] for name in found.keys() & again.keys()}
    agreement = compare_cameras(both, found)[0].pose_auc_10
    if agreement < REPEATABLE:
        logger.warning(
            f"{out}: the cameras may be wrong: an estimation with another seed agrees with only {agreement:.0%} of "
            "them. Compare renders with the photographs; photographs taken closer together help"
        )


def _poses(model: pycolmap.Reconstruction) -> dict[str, NDArray[np.float64]]:
    """World to camera [4, 4] of the registered views, by name."""
    views = [view for view in model.images.values() if view.has_pose]
    return {view.name: np.vstack([view.cam_from_world().matrix(), np.eye(4)[3]]) for view in views}


def _largest_first(
    out: Path, count: int, options: pycolmap.IncrementalPipelineOptions
) -> list[pycolmap.Reconstruction]:
    """The models of one mapping, from the widest first pair with which enough photographs register."""
    models: list[pycolmap.Reconstruction] = []
    for angle in FIRST_PAIR_ANGLES:
        found = _incremental_mapping(out, count, angle, options)
        grown = [model for model in found if all(map(is_plausible, model.cameras.values()))]
        if _registered(grown) > _registered(models):
            models = grown
        if _registered(models) > ENOUGH * count:
            break
    return models


def _registered(models: list[pycolmap.Reconstruction]) -> int:
    """How many views the first of the models has."""
    return models[0].num_reg_images() if models else 0


def _incremental_mapping(
    out: Path, count: int, angle: float, options: pycolmap.IncrementalPipelineOptions
) -> list[pycolmap.Reconstruction]:
    """The models that grow from a first pair whose rays meet at `angle` degrees, the largest first."""
    scratch = out / MAPPING
    snapshots = scratch / "snapshots"
    snapshots.mkdir(parents=True, exist_ok=True)
    begun = sorted(snapshots.iterdir())[-2:-1]  # the last one may be half written
    options.snapshot_path = snapshots
    options.mapper.init_min_tri_angle = angle
    with tqdm(total=count, desc=f"mapping, first pair {angle:.0f} degrees apart", unit="image") as bar:
        starts = iter([len(read_images(begun[0]))] if begun else [])
        call = partial(
            pycolmap.incremental_mapping,
            out / DATABASE,
            out / "images",
            scratch,
            options,
            input_path=begun[0] if begun else "",
            initial_image_pair_callback=lambda: _restarted(bar, next(starts, 2)),
            next_image_callback=lambda: bar.update(1),
        )
        models = matching.interruptible(call)
    shutil.rmtree(scratch)
    return sorted(models.values(), key=lambda model: -model.num_reg_images())


def _restarted(bar: tqdm, registered: int) -> None:
    """A bar for another model: each begins with views of its own."""
    bar.reset()
    bar.update(registered)
