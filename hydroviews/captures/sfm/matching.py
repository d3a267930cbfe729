"""SIFT features and matches by pycolmap on the CPU, with progress; Ctrl-C stops it, the database resumes it."""

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.images import image_size, read_image, to_uint8, without_streaks
from hydroviews.scene.masks import find_mask, mask_name

pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)  # progress bars are enough

MAX_FEATURES = 4096
MAX_ERROR = 4.0  # pixels by which a feature may be off
RAINY_RATIO = 0.9  # of the distances of a descriptor to the nearest and to the second nearest, at most
MAX_IMAGE_SIZE = 1600  # pixels of the longer side; larger photographs are shrunk for detection alone

# Units of progress; Ctrl-C waits for the end of one.
IMAGES_AT_ONCE = max(8, 2 * (os.cpu_count() or 1))
PAIRS_AT_ONCE = 100

# Matching all pairs grows with the square of the views; above this many a sequence is assumed.
EXHAUSTIVE_LIMIT = 80
OVERLAP = 8  # views before and after, and those 16, 32, 64... away
KEYFRAMES = 40  # evenly spaced views matched with each other, which closes loops
NEIGHBOURS = 12  # views matched with each one where poses are known
MAX_ANGLE = 60.0  # degrees between viewing directions up to which features match

Result = TypeVar("Result")
Pair = tuple[int, int]


def interruptible(call: Callable[..., Result], tick: Callable[[], object] = lambda: None) -> Result:
    """Run a long pycolmap call so that Ctrl-C stops it at its next safe point.

    Do not open the database meanwhile: pycolmap ends the process when it finds it locked.

    Args:
        call: accepts `cancellation_token`, a pycolmap.CancellationToken that stops it.
        tick: called several times a second while it runs.
    """
    token = pycolmap.CancellationToken()
    finished = threading.Event()
    results: list[Result] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(call(cancellation_token=token))
        except BaseException as error:  # raised in the waiting thread
            errors.append(error)
        finally:
            finished.set()

    try:
        threading.Thread(target=run).start()
        # Not Thread.join: where that is interrupted, Python 3.11 takes the thread for ended, and the process would end
        # in the middle of the call.
        while not finished.wait(0.2):
            tick()
    except KeyboardInterrupt:
        token.cancel()
        finished.wait()
        raise
    if errors:
        raise errors[0]
    return results[0]


def copy_without_streaks(images: Path, copies: Path, names: Sequence[str]) -> Path:
    """Write copies of the photographs without upright streaks, to detect no features of rain; returns their folder."""
    for name in tqdm(names, desc="without streaks", unit="image"):
        if not (copies / name).is_file():
            pixels = without_streaks(to_uint8(read_image(images / name)))
            ok, encoded = cv2.imencode(Path(name).suffix, pixels[..., ::-1])
            if not ok:
                raise ValueError(f"{name}: encoding failed for an array of shape {pixels.shape}")
            write_bytes(copies / name, encoded.tobytes())
    return copies


def register(
    database: Path,
    photographs: Path,
    names: Sequence[str],
    camera_model: str,
    *,
    shared: bool,
    masks: Path | None = None,
) -> None:
    """Add images and their cameras to the database, unless all of them are in it.

    Args:
        database: emptied if it has only some of them.
        photographs: folder of the files, whose Exif may give focal lengths.
        names: of all images.
        camera_model: COLMAP's name.
        shared: one camera for all photographs of a size, instead of one for each.
        masks: as for `extract`.

    Raises:
        InputError: there are masks, but not for every image; a photograph that cannot be read.
    """
    unmasked = [name for name in names if masks and find_mask(masks, name) is None]
    if unmasked:  # COLMAP would leave the image out
        raise InputError(
            f"{masks}: {len(unmasked)} of {len(names)} images have no mask",
            found=f"no {mask_name(unmasked[0])}",
            fix="write one for every image, white where nothing is hidden",
        )
    with pycolmap.Database.open(database) as opened:
        if opened.num_images() == len(names):
            return
        opened.clear_all_tables()
    by_size: dict[tuple[int, int], list[str]] = {}
    for name in names:
        by_size.setdefault(image_size(photographs / name) if shared else (0, 0), []).append(name)
    mode = pycolmap.CameraMode.SINGLE if shared else pycolmap.CameraMode.PER_IMAGE
    reader = pycolmap.ImageReaderOptions(camera_model=camera_model, mask_path=masks or "")
    for alike in by_size.values():  # cameras are shared within one call
        pycolmap.import_images(database, photographs, camera_mode=mode, image_names=alike, options=reader)


def extract(
    database: Path,
    images: Path,
    names: Sequence[str],
    camera_model: str,
    masks: Path | None = None,
) -> None:
    """Detect SIFT features, outside masks, in those registered images that have none in the database."""
    reader = pycolmap.ImageReaderOptions(camera_model=camera_model, mask_path=masks or "")
    options = pycolmap.FeatureExtractionOptions(max_image_size=MAX_IMAGE_SIZE, use_gpu=False)
    options.sift.max_num_features = MAX_FEATURES
    with tqdm(total=len(names), desc="features", unit="image") as bar:
        for chunk in _chunks(names, IMAGES_AT_ONCE):
            call = partial(
                pycolmap.extract_features,
                database,
                images,
                image_names=chunk,
                reader_options=reader,
                extraction_options=options,
                device=pycolmap.Device.cpu,
            )
            interruptible(call)
            bar.update(len(chunk))


def tolerance(long_side: int, rainy: bool) -> float:
    """Pixels by which a feature may be off: fewer in small photographs of rain, where more matches are wrong."""
    return max(MAX_ERROR * min(1.0, long_side / MAX_IMAGE_SIZE), MAX_ERROR / 2) if rainy else MAX_ERROR


def match(
    database: Path,
    names: Sequence[str],
    pairs: Iterable[Pair],
    seed: int,
    *,
    error: float = MAX_ERROR,
    rainy: bool = False,
) -> None:
    """Match and verify pairs of views, except those in the database.

    Args:
        database: with the features of all `names`.
        names: file names without blanks, which separate them in COLMAP's list of pairs.
        pairs: indices into `names`.
        seed: of the verification's random sampling.
        error: pixels by which a verified match may be off.
        rainy: take matches that are less distinct than usual, as rain changes descriptors; look for more of them near
            the epipolar lines of those that are verified; and leave out those that stay where they are in the picture,
            as drops on the lens do.
    """
    lines = [f"{names[i]} {names[j]}\n" for i, j in sorted(pairs)]
    list_path = database.with_name("pairs.txt")
    matching = pycolmap.FeatureMatchingOptions(use_gpu=False, guided_matching=rainy)
    matching.sift.max_ratio = RAINY_RATIO if rainy else matching.sift.max_ratio
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    verification.ransac.max_error = error
    verification.filter_stationary_matches = rainy
    with tqdm(total=len(lines), desc="matches", unit="pair") as bar:
        for chunk in _chunks(lines, PAIRS_AT_ONCE):
            list_path.write_text("".join(chunk))
            call = partial(
                pycolmap.match_image_pairs,
                database,
                matching_options=matching,
                pairing_options=pycolmap.ImportedPairingOptions(match_list_path=list_path),
                verification_options=verification,
                device=pycolmap.Device.cpu,
            )
            interruptible(call)
            bar.update(len(chunk))


def _chunks(items: Sequence[str], size: int) -> list[list[str]]:
    return [list(items[i : i + size]) for i in range(0, len(items), size)]


def all_pairs(count: int) -> set[Pair]:
    """Every view with every other."""
    return {(i, j) for i in range(count) for j in range(i + 1, count)}


def sequence_pairs(count: int) -> set[Pair]:
    """Neighbours in a sequence, views at distances growing as powers of two, and keyframes with each other."""
    steps = [*range(1, OVERLAP + 1)]
    while steps[-1] * 2 < count:
        steps.append(steps[-1] * 2)
    near = {(i, i + step) for step in steps for i in range(count - step)}
    keyframes = np.unique(np.linspace(0, count - 1, min(KEYFRAMES, count)).round().astype(int))
    return near | {(int(a), int(b)) for a in keyframes for b in keyframes if a < b}


def pose_pairs(world_to_camera: NDArray[np.float64]) -> set[Pair]:
    """Each view with up to NEIGHBOURS nearest ones whose viewing directions differ by at most MAX_ANGLE.

    Args:
        world_to_camera: [N, 4, 4].

    Returns:
        Pairs of indices, the smaller first.
    """
    rotations = world_to_camera[:, :3, :3]
    centres = -np.einsum("nji,nj->ni", rotations, world_to_camera[:, :3, 3])
    directions = rotations[:, 2]
    distances = np.linalg.norm(centres[:, None] - centres, axis=-1)
    distances[directions @ directions.T < np.cos(np.radians(MAX_ANGLE))] = np.inf
    np.fill_diagonal(distances, np.inf)
    pairs = set()
    for i, row in enumerate(distances):
        near = np.argsort(row, kind="stable")[:NEIGHBOURS]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in near if np.isfinite(row[j])}
    return pairs
