"""Matches between photographs in rain, of which `matching.match` finds too few.

Rain changes descriptors, so less distinct ones are matched. Drops on the lens match best where they are, so what stays
in one place of the picture is left out. Pairs that have enough in common are matched again near the epipolar lines;
others would find matches near any lines.
"""

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import pycolmap

from hydroviews.captures.sfm.matching import MAX_IMAGE_SIZE, listed, match_listed
from hydroviews.captures.sfm.pairs import Pair

MAX_RATIO = 0.9  # of the distances of a descriptor to the nearest and to the second nearest; pycolmap's is 0.8
# Verified matches of a pair, and their share. Of pairs of courtyard and flower with 25 to 40, four in five are right,
# of those with fewer one in forty.
MIN_MATCHES, MIN_SHARE = 25, 0.25
ERRORS = (2.0, 4.0)  # pixels by which a match may be off: in small photographs, in those of MAX_IMAGE_SIZE and above
GUIDED = ".guided"  # beside the database, with the pairs matched again


def tolerance(long_side: int) -> float:
    """Pixels by which a match may be off, for the longer side of photographs in pixels."""
    least, most = ERRORS
    return max(least, most * min(1.0, long_side / MAX_IMAGE_SIZE))


def match(database: Path, names: Sequence[str], pairs: Iterable[Pair], seed: int, error: float) -> None:
    """Match and verify pairs of views, except those in the database.

    Args:
        database: with the features of all `names`.
        names: file names without blanks.
        pairs: indices into `names`.
        seed: of the verification's random sampling.
        error: pixels by which a match may be off.
    """
    verification = pycolmap.TwoViewGeometryOptions(filter_stationary_matches=True)
    verification.min_num_inliers, verification.min_inlier_ratio = MIN_MATCHES, MIN_SHARE
    verification.ransac.random_seed, verification.ransac.max_error = seed, error
    options = pycolmap.FeatureMatchingOptions(use_gpu=False)
    options.sift.max_ratio = MAX_RATIO
    lines = listed(names, pairs)
    match_listed(database, lines, options, verification, "matches")
    done = database.with_name(database.name + GUIDED)
    again = _verified(database, lines, set(done.read_text().splitlines(True)) if done.is_file() else set())
    options.guided_matching = True
    match_listed(database, again, options, verification, "guided", partial(_forget, database), partial(_note, done))


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
    images = (opened.read_image_with_name(name) for name in line.split())
    return [image.image_id for image in images if image is not None]
