"""SIFT features and matches of photographs in rain, of which `matching` finds too few, and wrong ones on the lens.

Drops on the lens match best where they are, so features that stay in one place of the picture are left out. Pairs that
have enough in common are matched again, near their epipolar lines and less distinctly, as rain changes descriptors;
other pairs would find matches near any lines.
"""

import shutil
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from tqdm import tqdm

from hydroviews.captures.sfm import matching
from hydroviews.captures.sfm.features import image_id, read_features, write_features
from hydroviews.captures.sfm.lens import without_lens
from hydroviews.captures.sfm.pairs import Pair
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.cameras import fitted_size
from hydroviews.scene.images import Image, read_image, resize_area, to_uint8

Enhance = Callable[[Image], Image]

MIN_MATCHES, MIN_SHARE = 20, 0.25  # of a pair that must be verified, and of all its matches
# Samples for a pair: more find few further pairs, and wrong ones among them, but take four times as long.
MAX_TRIALS = 2000
# Of the distances of a descriptor to the nearest and to the second nearest, at most, for all pairs, and near epipolar
# lines; pycolmap's is 0.8.
RATIO, GUIDED_RATIO = 0.85, 0.9
# Pixels by which a match may be off: in small photographs, and in those of MAX_IMAGE_SIZE. In larger ones it may be off
# by more, as features are detected in shrunk ones.
ERRORS = (2.0, 4.0)

# Beside the database, under its name.
DETECTED, COPIES, GUIDED = ".detected", ".copies", ".guided"


def tolerance(long_side: int) -> float:
    """Pixels by which a match may be off, for the longer side of photographs in pixels."""
    least, most = ERRORS
    return max(least, most * long_side / matching.MAX_IMAGE_SIZE)


def verification_options(seed: int, error: float) -> pycolmap.TwoViewGeometryOptions:
    """How pairs are verified in rain; error: pixels by which a match may be off."""
    verification = pycolmap.TwoViewGeometryOptions(min_num_inliers=MIN_MATCHES, min_inlier_ratio=MIN_SHARE)
    verification.ransac.random_seed, verification.ransac.max_error = seed, error
    verification.ransac.max_num_trials = MAX_TRIALS
    return verification


def extract(
    database: Path,
    images: Path,
    names: Sequence[str],
    camera_model: str,
    error: float,
    masks: Path | None = None,
    enhance: Enhance | None = None,
) -> None:
    """Detect SIFT features without those that stay on the lens.

    Args:
        database: with the images registered; those that have features keep them.
        images: folder of the photographs.
        names: of all images.
        camera_model: COLMAP's name.
        error: pixels by which features of one place may be apart.
        masks: as for `matching.extract`.
        enhance: takes the rain out of a picture, without changing its size; features are those of enhanced pictures.

    Raises:
        InputError: fewer than two photographs have features that do not stay in one place, or an enhanced one has
            another size.
    """
    pictures = images
    if enhance:
        pictures = write_enhanced(images, database.with_name(database.name + COPIES), names, enhance)
    detected = database.with_name(database.name + DETECTED)
    matching.register(detected, pictures, names, camera_model, shared=True, masks=masks)
    matching.extract(detected, pictures, names, camera_model, masks)
    write_features(database, names, without_lens(images, read_features(detected, names), error))


def write_enhanced(images: Path, copies: Path, names: Sequence[str], enhance: Enhance) -> Path:
    """Write enhanced copies of the photographs under the same names, unless they are there; returns their folder."""
    for name in tqdm(names, desc="enhanced", unit="image"):
        if (copies / name).is_file():
            continue
        enhanced = read_enhanced(images / name, enhance)
        ok, encoded = cv2.imencode(Path(name).suffix, to_uint8(enhanced)[..., ::-1])
        if not ok:
            raise ValueError(f"{name}: encoding failed for an array of shape {enhanced.shape}")
        write_bytes(copies / name, encoded.tobytes())
    return copies


def read_enhanced(path: Path, enhance: Enhance) -> Image:
    """A photograph, enhanced at no more than MAX_IMAGE_SIZE, as features are detected at no more either.

    Raises:
        InputError: to another size; or it cannot be read.
    """
    image = read_image(path)
    size = image.shape[1], image.shape[0]
    shrunk = resize_area(image, *fitted_size(*size, matching.MAX_IMAGE_SIZE))
    enhanced = enhance(shrunk)
    if enhanced.shape != shrunk.shape:
        raise InputError(
            f"{path}: enhanced to another size",
            found=f"shape {enhanced.shape}",
            expected=f"{shrunk.shape}",
            fix="enhance without cropping or scaling",
        )
    if shrunk.shape == image.shape:
        return enhanced
    return np.asarray(cv2.resize(enhanced, size, interpolation=cv2.INTER_LINEAR), np.float32)


def forget_parts(database: Path) -> None:
    """Remove what only an unfinished estimation needs: features of each kind, and enhanced copies."""
    for suffix in (DETECTED, GUIDED):
        database.with_name(database.name + suffix).unlink(missing_ok=True)
    shutil.rmtree(database.with_name(database.name + COPIES), ignore_errors=True)


def match(database: Path, names: Sequence[str], pairs: Iterable[Pair], seed: int, error: float) -> None:
    """Match and verify pairs of views, except those in the database.

    Args:
        database: with the features of all `names`.
        names: file names without blanks.
        pairs: indices into `names`.
        seed: of the verification's random sampling.
        error: pixels by which a match may be off.
    """
    verification = verification_options(seed, error)
    options = pycolmap.FeatureMatchingOptions(use_gpu=False)
    options.sift.max_ratio = RATIO
    lines = matching.listed(names, pairs)
    matching.match_listed(database, lines, options, verification, "matches")
    done = database.with_name(database.name + GUIDED)
    again = _verified(database, lines, set(done.read_text().splitlines(True)) if done.is_file() else set())
    options.guided_matching, options.sift.max_ratio = True, GUIDED_RATIO
    matching.match_listed(
        database, again, options, verification, "guided", partial(_forget, database), partial(_note, done)
    )


def _verified(database: Path, lines: Sequence[str], done: set[str]) -> list[str]:
    """The pairs that have verified matches, but those that are done."""
    with pycolmap.Database.open(database) as opened:
        left = [line for line in lines if line not in done]
        return [line for line in left if len(opened.read_two_view_geometry(*_ids(opened, line)).inlier_matches)]


def _forget(database: Path, lines: Sequence[str]) -> None:
    """Remove the matches of pairs, which are matched anew: an interruption leaves such pairs to be begun again."""
    with pycolmap.Database.open(database) as opened:
        for line in lines:
            opened.delete_matches(*_ids(opened, line))
            opened.delete_two_view_geometry(*_ids(opened, line))


def _note(done: Path, lines: Sequence[str]) -> None:
    with done.open("a") as file:
        file.writelines(lines)


def _ids(opened: pycolmap.Database, line: str) -> list[int]:
    return [image_id(opened, name) for name in line.split()]
