"""Views that mapping put in a wrong place: they fit the points of all other views better somewhere else.

A view that is registered early, by a few wrong matches, stays where it is, and mapping never looks again. Once all
views are there, each has many more points to be registered by.
"""

import logging
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pycolmap
from numpy.typing import NDArray

from hydroviews.captures.sfm.mapping import MINIMUM, mapping_options, polished, without_lost_views

logger = logging.getLogger(__name__)

ROUNDS = 3  # of looking for misplaced views, at most
LEAST_ERRORS = 2.0  # standard errors by which more points must fit elsewhere

Model = pycolmap.Reconstruction
Array = NDArray[np.float64]


def settled(model: Model, database: Path, pictures: Path, error: float, seed: int) -> Model:
    """The model adjusted a last time, with misplaced views where they fit best, without views that fit nowhere.

    Args:
        model: of the views; stays as it is.
        database: with the keypoints and matches of all views.
        pictures: folder of the photographs.
        error: pixels by which a point may be off where a view belongs.
        seed: of the random sampling.
    """
    model = polished(model, error)
    for _ in range(ROUNDS):
        moved = misplaced(model, database, error, seed)
        if not moved:
            break
        logger.info("%d of %d views fit better elsewhere and are moved", len(moved), model.num_reg_images())
        model = pycolmap.Reconstruction(model)
        for image, pose in moved.items():
            view = model.images[image]
            assert view.frame is not None  # as of all registered views
            view.frame.set_cam_from_world(view.camera_id, pose)
        with TemporaryDirectory() as folder:
            options = mapping_options(seed)  # points may be a little further off than `error`, until views are adjusted
            model = polished(pycolmap.triangulate_points(model, database, pictures, folder, options=options), error)
    held = without_lost_views(model, error)
    whole = not MINIMUM <= held.num_reg_images() < model.num_reg_images()
    return held if whole else polished(held, error)


def misplaced(model: Model, database: Path, error: float, seed: int) -> dict[int, pycolmap.Rigid3d]:
    """Better poses, camera from world, of the images that fit the points of others better elsewhere."""
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error, options.ransac.random_seed = error, seed
    found = {}
    with pycolmap.Database.open(database) as opened:
        for image, (places, points) in points_of_others(model, opened).items():
            view = model.images[image]
            camera = model.cameras[view.camera_id]
            estimate = pycolmap.estimate_and_refine_absolute_pose(places, points, camera, options)
            if estimate is None:
                continue
            pose = estimate["cam_from_world"]
            here, there = (fitting(camera, one, places, points, error) for one in (view.cam_from_world(), pose))
            if there - here > LEAST_ERRORS * np.sqrt(there):
                found[image] = pose
    return found


def points_of_others(model: Model, database: pycolmap.Database) -> dict[int, tuple[Array, Array]]:
    """For each image, places [M, 2] of its features and points [M, 3] that match in other images.

    Matches need not be verified. Points that only the image and one other show say nothing of the image.
    """
    ids = sorted(model.points3D)
    row_of = {point: row for row, point in enumerate(ids)}
    positions = np.array([model.points3D[point].xyz for point in ids]).reshape(-1, 3)
    short = np.array([model.points3D[point].track.length() < 3 for point in ids], bool)
    images = sorted(model.reg_image_ids())
    rows = {image: _rows(model.images[image], row_of) for image in images}
    found = {}
    for image in images:
        own = np.zeros(len(ids), bool)
        own[rows[image][rows[image] >= 0]] = True
        pairs = [np.zeros((0, 2), np.int64)]
        for other in images:
            if other != image and database.exists_matches(image, other):
                matches = np.asarray(database.read_matches(image, other), np.int64)
                pairs.append(np.stack([matches[:, 0], rows[other][matches[:, 1]]], axis=1))
        both = np.unique(np.concatenate(pairs), axis=0)
        both = both[both[:, 1] >= 0]
        both = both[~(own & short)[both[:, 1]]]
        keypoints = np.asarray(database.read_keypoints(image), np.float64)
        found[image] = keypoints[both[:, 0], :2], positions[both[:, 1]]
    return found


def fitting(camera: pycolmap.Camera, pose: pycolmap.Rigid3d, places: Array, points: Array, error: float) -> int:
    """How many points [M, 3] a camera sees within `error` pixels of their places [M, 2]."""
    seen = points @ pose.rotation.matrix().T + pose.translation
    front = seen[:, 2] > 0
    apart = np.linalg.norm(camera.img_from_cam(seen[front]) - places[front], axis=1)
    return int((apart <= error).sum())


def _rows(image: pycolmap.Image, rows: dict[int, int]) -> NDArray[np.int64]:
    """The row of each feature's point; -1 for none."""
    return np.array([rows[p.point3D_id] if p.has_point3D() else -1 for p in image.points2D], np.int64)
