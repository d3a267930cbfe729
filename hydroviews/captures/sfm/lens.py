"""Features that stay in one place of the lens over many views: drops and dirt, not the scene."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hydroviews.captures.sfm.features import Features
from hydroviews.errors import InputError

logger = logging.getLogger(__name__)

COMPARED = 60  # views, spread evenly, in which a feature is looked for again
# Cosine between descriptors, and the share of views. Of the features of courtyard and flower without rain, 0 to 2 in a
# thousand recur so; with drops on the lens up to 5 in a hundred, of bonsai 9, which are what bends the cameras.
ALIKE, SHARE = 0.8, 0.2
LEAST = 3  # views


def without_lens(images: Path, views: Sequence[Features], error: float) -> list[Features]:
    """The features of all views but those on the lens.

    Args:
        images: folder of the photographs, for the error.
        views: the features of each.
        error: pixels by which a place may differ.

    Raises:
        InputError: fewer than two views have others.
    """
    staying = on_the_lens(views, error)
    total, left = sum(map(len, views)), sum(int(mask.sum()) for mask in staying)
    logger.info("%d of %d features stay in one place of the lens and are left out", left, total)
    moving = [view.where(~mask) for view, mask in zip(views, staying, strict=True)]
    if left and sum(len(view) > 0 for view in moving) < 2:
        raise InputError(
            f"{images}: nothing moves from view to view",
            found="features in one place of all photographs: drops or dirt on the lens, or a camera that stood still",
            expected="photographs of a scene from several places",
            fix="wipe the lens, or move the camera",
        )
    return moving


def on_the_lens(views: Sequence[Features], radius: float) -> list[NDArray[np.bool_]]:
    """Which features recur, with a like descriptor, at the same place of many other views.

    A scene's features move with the camera, unless it stands still.

    Args:
        views: the features of all.
        radius: pixels by which a place may differ.

    Returns:
        A mask [K] for every view; without any in a view of fewer than `LEAST` others.
    """
    from scipy.spatial import KDTree

    compared = np.unique(np.linspace(0, len(views) - 1, min(len(views), COMPARED)).round().astype(int))
    places = KDTree(np.concatenate([views[i].keypoints[:, :2] for i in compared]))
    directions = np.concatenate([_normalised(views[i].descriptors) for i in compared])
    view_of = np.repeat(compared, [len(views[i]) for i in compared])
    found = []
    for i, view in enumerate(views):
        near = KDTree(view.keypoints[:, :2]).sparse_distance_matrix(places, radius, output_type="coo_matrix")
        own, others = near.row, near.col
        alike = np.einsum("kd,kd->k", _normalised(view.descriptors)[own], directions[others]) > ALIKE
        alike &= view_of[others] != i
        seen = np.unique(own[alike].astype(np.int64) * len(views) + view_of[others[alike]])  # each view once
        times = np.bincount(seen // len(views), minlength=len(view))
        found.append(times >= max(LEAST, SHARE * (len(compared) - (i in compared))))
    return found


def _normalised(descriptors: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float32]:
    lengths = np.linalg.norm(descriptors.astype(np.float32), axis=1, keepdims=True)
    return np.asarray(descriptors / np.maximum(lengths, 1), np.float32)
