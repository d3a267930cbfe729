"""SIFT features and matches by pycolmap on the CPU, with progress; Ctrl-C stops it, the database resumes it."""

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import pycolmap
from tqdm import tqdm

from hydroviews.captures.sfm.pairs import Pair
from hydroviews.captures.sfm.room import PAIRS
from hydroviews.errors import InputError
from hydroviews.scene.exif import lens_identity
from hydroviews.scene.images import image_size
from hydroviews.scene.masks import find_mask, mask_name

pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)  # progress bars are enough

MAX_FEATURES = 4096
MAX_IMAGE_SIZE = 1600  # pixels of the longer side; larger photographs are shrunk for detection alone
# Share of the longer side where Exif says nothing: a telephone's. From pycolmap's 1.2, views from one side may end with
# a scene turned inside out.
FOCAL_LENGTH = 0.9

# Units of progress; Ctrl-C waits for the end of one.
IMAGES_AT_ONCE = max(8, 2 * (os.cpu_count() or 1))
PAIRS_AT_ONCE = 100

Result = TypeVar("Result")


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
    except (KeyboardInterrupt, SystemExit):  # the latter of SIGTERM and SIGHUP, see `cli.processes.Ended`
        token.cancel()
        finished.wait()
        raise
    if errors:
        raise errors[0]
    return results[0]


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
        photographs: folder of the files, whose Exif may give focal lengths; `FOCAL_LENGTH` where it does not.
        names: of all images.
        camera_model: COLMAP's name.
        shared: one camera for all photographs of a size and of a lens, as Exif says, instead of one for each.
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
    by_lens: dict[tuple, list[str]] = {}
    for name in names:
        path = photographs / name
        lens = (*image_size(path), *lens_identity(path)) if shared else ()
        by_lens.setdefault(lens, []).append(name)
    mode = pycolmap.CameraMode.SINGLE if shared else pycolmap.CameraMode.PER_IMAGE
    reader = pycolmap.ImageReaderOptions(camera_model=camera_model, mask_path=masks or "")
    reader.default_focal_length_factor = FOCAL_LENGTH
    for alike in by_lens.values():  # cameras are shared within one call
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


def match(database: Path, names: Sequence[str], pairs: Iterable[Pair], seed: int) -> None:
    """Match and verify pairs of views, except those in the database.

    Args:
        database: with the features of all `names`.
        names: file names without blanks, which separate them in COLMAP's list of pairs.
        pairs: indices into `names`.
        seed: of the verification's random sampling.
    """
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    options = pycolmap.FeatureMatchingOptions(use_gpu=False)
    match_listed(database, listed(names, pairs), options, verification, "matches")


def listed(names: Sequence[str], pairs: Iterable[Pair]) -> list[str]:
    """The lines of COLMAP's list of pairs."""
    return [f"{names[i]} {names[j]}\n" for i, j in sorted(pairs)]


def match_listed(
    database: Path,
    lines: Sequence[str],
    options: pycolmap.FeatureMatchingOptions,
    verification: pycolmap.TwoViewGeometryOptions,
    title: str,
    before: Callable[[Sequence[str]], object] = lambda lines: None,
    after: Callable[[Sequence[str]], object] = lambda lines: None,
) -> None:
    """Match and verify the pairs of a list, some at a time, with what is to be done before and after these."""
    list_path = database.with_name(PAIRS)
    call = partial(
        pycolmap.match_image_pairs,
        database,
        matching_options=options,
        pairing_options=pycolmap.ImportedPairingOptions(match_list_path=list_path),
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )
    _listed_call(call, list_path, lines, title, before, after)


def verify_listed(database: Path, lines: Sequence[str], verification: pycolmap.TwoViewGeometryOptions) -> None:
    """Verify the matches of the pairs of a list, except those that are verified."""
    with pycolmap.Database.open(database) as opened:
        ids = {image.name: image.image_id for image in opened.read_all_images()}
        left = [line for line in lines if not opened.exists_two_view_geometry(*(ids[name] for name in line.split()))]
    list_path = database.with_name(PAIRS)
    _listed_call(partial(pycolmap.verify_matches, database, list_path, verification), list_path, left, "verified")


def _listed_call(
    call: Callable[..., object],
    list_path: Path,
    lines: Sequence[str],
    title: str,
    before: Callable[[Sequence[str]], object] = lambda lines: None,
    after: Callable[[Sequence[str]], object] = lambda lines: None,
) -> None:
    """Call pycolmap for the pairs of a list, some at a time."""
    with tqdm(total=len(lines), desc=title, unit="pair") as bar:
        for chunk in _chunks(lines, PAIRS_AT_ONCE):
            before(chunk)
            list_path.write_text("".join(chunk))
            interruptible(call)
            after(chunk)
            bar.update(len(chunk))


def _chunks(items: Sequence[str], size: int) -> list[list[str]]:
    return [list(items[i : i + size]) for i in range(0, len(items), size)]
