"""Masks that the user draws, white where hidden, written into a capture in the form of `hydroviews.scene.masks`.

They are one picture for all frames, a folder of pictures named like the frames, or a video in step with the one the
frames are from.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from hydroviews.captures.video.decoding import open_video, video_frames
from hydroviews.captures.video.frames import IMAGES
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.files.settings_guard import claim_folder
from hydroviews.formats.mask_files.hidden_share import hidden_notes
from hydroviews.formats.photographs import photographs_below, some
from hydroviews.scene.cameras import same_shape
from hydroviews.scene.images import SUFFIXES, read_image, to_uint8, write_png
from hydroviews.scene.masks import MASKS, Ignored, fit_ignored, mask_name, read_grey, write_ignored

SETTINGS = "masks.json"
WHITE = 128  # from this grey on a pixel is hidden: videos and JPEG files blur black and white
RADIUS = 5.0  # pixels: neighbourhood that inpainting draws from
SAME_TIME = 0.002  # seconds between a mask and its frame
LATE = 0.5  # seconds that a video of masks may end early

Times = Mapping[str, float]  # seconds by frame name


def put_masks(given: Path, out: Path, times: Times, inpaint: bool) -> list[str]:
    """Write a mask for every frame of the capture `out`, and fill in hidden pixels if asked to.

    A frame with a mask file is finished: a call after an interruption resumes with the others.

    Args:
        given: a picture, a folder or a video; white is hidden.
        out: the capture, with `images`.
        times: seconds of its frames in the video, by file name.
        inpaint: replace hidden pixels of the frames by what surrounds them (Telea 2004).

    Returns:
        Sentences about frames without a mask, and masks that hide most pixels.

    Raises:
        InputError: masks of another shape, none that fits a frame's name, a video of masks that is too short, masks
            that hide every pixel, or a capture that has other masks.
    """
    if not given.exists():
        raise InputError(f"--masks {given}: no such file or folder")
    shares = [0.0 if ignored is None else float(ignored.mean()) for _, ignored in _given(given, times)]
    notes = hidden_notes(f"--masks {given}", shares, "white")  # before they take the folder, and pixels by inpainting
    _claim(given, out, inpaint)
    bare = []
    for name, ignored in tqdm(_given(given, times), total=len(times), desc="masks", unit="frame"):
        image, path = out / IMAGES / name, out / MASKS / mask_name(name)
        if ignored is None:
            bare.append(name)
        if path.is_file():
            continue
        pixels = to_uint8(read_image(image))
        hidden = np.zeros(pixels.shape[:2], bool) if ignored is None else _fitted(given, ignored, pixels.shape)
        if inpaint and hidden.any():
            write_png(image, fill(pixels, hidden))
        write_ignored(path, hidden)
    return notes + ([f"{len(bare)} of {len(times)} frames have no mask in {given}: {some(bare)}"] if bare else [])


def fill(pixels: np.ndarray, ignored: Ignored) -> np.ndarray:
    """The picture [H, W, 3] uint8 with hidden pixels replaced by inpainting; none of their values is used."""
    known = np.where(ignored[..., None], np.uint8(0), pixels)
    if ignored.all():
        return known
    return cv2.inpaint(known, ignored.astype(np.uint8), RADIUS, cv2.INPAINT_TELEA)


def _claim(given: Path, out: Path, inpaint: bool) -> None:
    files = photographs_below(given) if given.is_dir() else [given]
    digests = {path.relative_to(given).as_posix() if given.is_dir() else "": sha256(path) for path in files}
    if (out / "sparse").is_dir() and not (out / SETTINGS).is_file():
        raise InputError(
            f"{out}: the cameras were estimated without masks",
            fix="choose another --out, or remove that folder",
        )
    claim_folder(
        out / SETTINGS,
        {"sha256": digests, "inpaint": inpaint},
        taken="holds frames with other masks",
        foreign=None,
        fix="choose another --out, or remove that folder",
    )


def _given(given: Path, times: Times) -> Iterator[tuple[str, Ignored | None]]:
    """The mask of each frame at its own size, None where there is none."""
    if given.is_dir():
        yield from _from_folder(given, times)
    elif given.suffix.lower() in SUFFIXES:
        ignored = read_grey(given) >= WHITE
        yield from ((name, ignored) for name in times)
    else:
        yield from _from_video(given, times)


def _from_folder(folder: Path, times: Times) -> Iterator[tuple[str, Ignored | None]]:
    files = {path.stem: path for path in photographs_below(folder)}
    if not files.keys() & {Path(name).stem for name in times}:
        raise InputError(
            f"--masks {folder}: no mask is named like a frame",
            found=some(sorted(path.name for path in files.values())),
            expected=f"{some(sorted(times))}, white where hidden",
            fix="take the frames alone first (--frames-only) and name the masks like them",
        )
    for name in times:
        path = files.get(Path(name).stem)
        yield name, read_grey(path) >= WHITE if path else None


def _from_video(path: Path, times: Times) -> Iterator[tuple[str, Ignored | None]]:
    """The mask at a frame's time; between two masks, pixels that either hides."""
    waiting, before = list(times.items()), None
    last = 0.0
    with open_video(path) as video:
        for frame in video_frames(video):
            last = frame.time
            ignored = np.asarray(frame.pixels.max(axis=2) >= WHITE)
            while waiting and waiting[0][1] <= last + SAME_TIME:
                name, time = waiting.pop(0)
                exact = before is None or abs(time - last) <= SAME_TIME
                yield name, ignored if exact else ignored | before
            before = ignored
    if waiting and (before is None or waiting[0][1] > last + LATE or waiting[-1][1] > last + LATE):
        raise InputError(
            f"--masks {path}: shorter than the video",
            found=f"{last:.1f} s of masks",
            expected=f"masks up to {waiting[-1][1]:.1f} s",
            fix="write a mask for every frame of the video",
        )
    yield from ((name, before) for name, _ in waiting)


def _fitted(given: Path, ignored: Ignored, shape: Sequence[int]) -> Ignored:
    size, wanted = (ignored.shape[1], ignored.shape[0]), (shape[1], shape[0])
    if not same_shape(size, wanted):
        raise InputError(
            f"--masks {given}: of another shape than the frames",
            found=f"{size[0]}x{size[1]} pixels",
            expected=f"{wanted[0]}x{wanted[1]}, or larger or smaller of the same shape",
        )
    return fit_ignored(ignored, *wanted)
