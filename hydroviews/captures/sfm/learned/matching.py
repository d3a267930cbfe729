"""Learned features and verified matches of photographs, in rain and in dry weather, into COLMAP's database.

Each step keeps what it has done beside the database, so that a call after an interruption goes on.
"""

import logging
from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import pycolmap
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.captures.sfm import matching
from hydroviews.captures.sfm.features import Features, image_id
from hydroviews.captures.sfm.learned.extraction import KEPT, device
from hydroviews.captures.sfm.learned.lighterglue import LighterGlue, Prepared
from hydroviews.captures.sfm.learned.ranking import ranked_pairs
from hydroviews.captures.sfm.learned.stationary import without_stationary
from hydroviews.captures.sfm.learned.xfeat import Keypoints
from hydroviews.captures.sfm.pairs import Pair
from hydroviews.files.atomic import replacing

logger = logging.getLogger(__name__)

Found = dict[Pair, NDArray[np.int64]]

PREPARED = 64  # pictures whose first layer is remembered: bounds the memory
SAME_PLACE = 2.0  # times the error by which matches in one place of the lens may be apart


def match(
    database: Path,
    folder: Path,
    names: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    views: Sequence[Features],
    pairs: Iterable[Pair] | None,
    verification: pycolmap.TwoViewGeometryOptions,
) -> None:
    """Match and verify pairs of views, without what is on the lens.

    Args:
        database: with the images registered; gets keypoints, matches and verified matches.
        folder: gets what LighterGlue found, a file for the pairs of each first view.
        names: of all images.
        sizes: their heights and widths.
        views: their features, the strongest first.
        pairs: indices into `names`; None for each view's best partners.
        verification: its largest error is also by how much a match may be off elsewhere.
    """
    error, least = verification.ransac.max_error, verification.min_num_inliers
    radius = SAME_PLACE * error
    views = [view.strongest(KEPT) for view in views]
    chosen = sorted(ranked_pairs(views, radius) if pairs is None else pairs)
    raw = match_pairs(folder, names, sizes, views, chosen)
    moving = without_stationary(views, raw, radius)
    logger.info(
        "%d of %d matches stay in place on the lens and are left out", _total(raw) - _total(moving), _total(raw)
    )
    enough = {pair: found for pair, found in moving.items() if len(found) >= least}
    write(database, names, views, enough)
    matching.verify_listed(database, matching.listed(names, enough), verification)


def match_pairs(
    folder: Path,
    names: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    views: Sequence[Features],
    pairs: Sequence[Pair],
) -> Found:
    """Matches of pairs by LighterGlue, kept in a folder with a file for the pairs of each first view."""

    @cache
    def network() -> LighterGlue:
        return LighterGlue(device())

    @lru_cache(PREPARED)
    def prepared(view: int) -> Prepared:
        return network().prepare(keypoints_of(views[view]), sizes[view])

    found: Found = {}
    with tqdm(total=len(pairs), desc="matches", unit="pair") as bar:
        for first in sorted({i for i, _ in pairs}):
            file, others = folder / f"{names[first]}.matches.npz", [j for i, j in pairs if i == first]
            if not file.is_file():
                tables = {names[j]: network().match(prepared(first), prepared(j))[0].numpy() for j in others}
                with replacing(file) as temporary, temporary.open("wb") as opened:
                    np.savez_compressed(opened, **tables)
            with np.load(file) as stored:
                found |= {(first, j): stored[names[j]] for j in others}
            bar.update(len(others))
    return found


def keypoints_of(features: Features) -> Keypoints:
    """Features as the networks take them; all count alike."""
    places, descriptors = torch.from_numpy(features.keypoints), torch.from_numpy(features.descriptors)
    return Keypoints(places, descriptors, torch.ones(len(features)))


def write(database: Path, names: Sequence[str], views: Sequence[Features], matches: Found) -> None:
    """Write keypoints and matches of images in a database that has none of them."""
    with pycolmap.Database.open(database) as opened:
        ids = [image_id(opened, name) for name in names]
        for image, view in zip(ids, views, strict=True):
            if not opened.exists_keypoints(image):
                opened.write_keypoints(image, np.ascontiguousarray(view.keypoints, np.float32))
        for (i, j), found in matches.items():
            if not opened.exists_matches(ids[i], ids[j]):
                opened.write_matches(ids[i], ids[j], np.ascontiguousarray(found, np.uint32))


def _total(matches: Found) -> int:
    return sum(map(len, matches.values()))
