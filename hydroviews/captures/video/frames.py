"""Pictures out of a film: the sharpest one near each instant, as PNG files.

    <out>/video.json       the film and the settings
    <out>/frames.json      time and sharpness of each frame
    <out>/images/*.png     frame-00000.png is the one near the first instant

A call that was interrupted goes on where it stopped; other settings or another film in the same folder are refused.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, sha256, write_json
from hydroviews.files.settings_guard import claim_folder
from hydroviews.scene.images import without_streaks, write_png
from hydroviews.scene.masks import MASKS, mask_name

SETTINGS, FILE, IMAGES = "video.json", "frames.json", "images"
NEAR = 0.25  # seconds to either side of an instant in which the sharpest frame is looked for
SHARE = 0.45  # of the time between two instants, where that is less
ANALYSED_SIDE = 480  # pixels: sharpness is measured at this size
WHOLE = 0.98  # a film is cut short if fewer of its frames can be read
FEWEST = 3  # frames that a scene can be made of

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class FrameChoice:
    """Which frames are taken, and how large."""

    rate: float = 1.0  # frames a second
    long_side: int | None = None  # pixels; a film is never enlarged

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise InputError(f"--rate {self.rate}: no rate", expected="frames a second, more than 0")
        if self.long_side is not None and self.long_side < 1:
            raise InputError(f"--long-side {self.long_side}: no size", expected="at least 1 pixel")


class Film(NamedTuple):
    """A film that is open."""

    capture: cv2.VideoCapture
    path: Path
    rate: float  # frames a second by its header; 0 if it does not say
    length: int  # frames by its header; 0 if it does not say


@dataclass
class Progress:
    """How much of a film has been read."""

    frames: int = 0
    seconds: float = 0.0


class Candidate(NamedTuple):
    """A frame that may be taken."""

    instant: int  # the how-manieth instant it is near
    time: float  # seconds from the film's beginning
    sharpness: float
    pixels: Pixels  # [H, W, 3], RGB


@contextmanager
def open_film(path: Path) -> Iterator[Film]:
    """Open a film; pictures come out upright, as the phone that took it says.

    Raises:
        InputError: no such file, or not a film.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # its errors are told in plain words below
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise InputError(
                f"{path}: cannot be read as a film",
                found=f"{path.stat().st_size} bytes",
                expected="a video file, such as .mp4, .mov, .mkv or .avi",
                fix="copy it again if it may be cut short; convert it with ffmpeg if it is of a rare kind",
            )
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        yield Film(capture, path, rate if 0 < rate < 1e4 else 0.0, int(count) if 0 < count < 1e9 else 0)
    finally:
        capture.release()


def frame_times(film: Film) -> Iterator[float]:
    """Step through a film: seconds from its first frame, by its own time stamps where it has any.

    Raises:
        InputError: it has neither time stamps nor a frame rate.
    """
    first = last = None
    while film.capture.grab():
        stamp = film.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if first is None or last is None:
            first, last = stamp, 0.0
        elif stamp - first > last:
            last = stamp - first
        elif film.rate:
            last += 1 / film.rate
        else:
            raise InputError(f"{film.path}: neither time stamps nor a frame rate", fix="convert it with ffmpeg")
        yield last


def sharpness(pixels: Pixels) -> float:
    """Mean squared gradient of the grey picture once upright streaks are taken out, larger for sharper pictures.

    Of 110 pairs of a sharp rainy picture
    and one blurred by 3 to 9 of 800 pixels with a third more rain it prefers the sharp one in 106, and rain alone
    changes it by 3 %; for the variance of the Laplacian these are 102 and 13 %.

    Args:
        pixels: uint8 [H, W, 3].
    """
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    scale = ANALYSED_SIDE / max(grey.shape)
    if scale < 1:
        size = max(1, round(grey.shape[1] * scale)), max(1, round(grey.shape[0] * scale))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    plain = without_streaks(np.asarray(grey, np.uint8)).astype(np.float32)
    across, along = cv2.Sobel(plain, cv2.CV_32F, 1, 0), cv2.Sobel(plain, cv2.CV_32F, 0, 1)
    return float((across**2 + along**2).mean())


def take_frames(path: Path, out: Path, choice: FrameChoice) -> list[str]:
    """Write the sharpest frame near each instant, `choice.rate` of them a second, beginning with the first frame.

    Args:
        path: the film.
        out: gets `frames.json` and `images`.
        choice: which and how large.

    Returns:
        Sentences about what is odd with the film; none where all is well.

    Raises:
        InputError: not a film, too short, no frame can be read, or `out` holds frames of another one.
    """
    with open_film(path) as film:
        source = {"video": path.name, "bytes": path.stat().st_size, "sha256": sha256(path)}
        claim_folder(
            out / SETTINGS,
            {**source, **asdict(choice)},
            taken="holds frames of another film, or taken otherwise",
            foreign="holds files that no film was taken to",
            fix="choose another --out, or remove that folder",
            ignored=("video",),
        )
        state: dict[str, Any] = read_json(out / FILE) if (out / FILE).is_file() else {}
        if not state or not all((out / IMAGES / frame["name"]).is_file() for frame in state["frames"]):
            state = _take(film, out, choice)
    if state["seconds"] * choice.rate < FEWEST or len(state["frames"]) < FEWEST:
        raise _too_short(path, choice, state)
    return list(state["notes"])


def _take(film: Film, out: Path, choice: FrameChoice) -> dict[str, Any]:
    """Go through the film and write what is not there yet; returns what `frames.json` says in the end."""
    frames, seen = [], Progress()
    for best in _best_frames(film, choice, seen):
        name = f"frame-{best.instant:05d}.png"
        if not (out / IMAGES / name).is_file():
            (out / MASKS / mask_name(name)).unlink(missing_ok=True)  # its picture has nothing hidden yet
            write_png(out / IMAGES / name, _fitted(best.pixels, choice.long_side))
        facts = {"instant": best.instant / choice.rate, "time": best.time, "sharpness": best.sharpness}
        frames.append({"name": name, **{key: round(value, 4) for key, value in facts.items()}})
    state = {
        "seconds": round(seen.seconds + (1 / film.rate if film.rate else 0.0), 3),
        "frames_in_film": seen.frames,
        "notes": _notes(film, choice, seen, len(frames)),
        "frames": frames,
    }
    if not frames:
        raise InputError(f"{film.path}: not one frame can be read", fix="copy the film again, or convert it")
    write_json(out / FILE, state)
    return state


def _best_frames(film: Film, choice: FrameChoice, seen: Progress) -> Iterator[Candidate]:
    """The sharpest frame near each instant that has one; `seen` is kept up to date."""
    near = min(NEAR, SHARE / choice.rate)
    best: Candidate | None = None
    bar = tqdm(total=film.length or None, desc="frames", unit="frame")
    for time in frame_times(film):
        seen.frames, seen.seconds = seen.frames + 1, time
        bar.update()
        instant = round(time * choice.rate)
        if abs(time - instant / choice.rate) > near:
            continue
        good, pixels = film.capture.retrieve()
        if not good:
            continue
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
        value = sharpness(np.asarray(pixels, np.uint8))
        if best is not None and best.instant != instant:
            yield best
            best = None
        if best is None or value > best.sharpness:
            best = Candidate(instant, time, value, np.asarray(pixels, np.uint8))
    bar.close()
    if best is not None and best.instant / choice.rate <= seen.seconds + 1e-6:  # not of an instant after the end
        yield best


def _fitted(pixels: Pixels, long_side: int | None) -> Pixels:
    height, width = pixels.shape[:2]
    scale = (long_side or max(width, height)) / max(width, height)
    if scale >= 1:
        return pixels
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)


def _notes(film: Film, choice: FrameChoice, seen: Progress, taken: int) -> list[str]:
    notes = []
    if film.length and seen.frames < WHOLE * film.length:
        notes.append(f"{film.path.name} is cut short: {seen.frames} of its {film.length} frames could be read")
    wanted = int(seen.seconds * choice.rate) + 1
    if taken < wanted:
        notes.append(f"{wanted - taken} of {wanted} instants have no frame near them: the film has too few a second")
    return notes


def _too_short(path: Path, choice: FrameChoice, state: dict[str, Any]) -> InputError:
    seconds = state["seconds"]
    rate = 20 / seconds if seconds else 0.0
    return InputError(
        f"{path}: too short at a rate of {choice.rate:g} a second",
        found=f"{seconds:.1f} s, which gives {len(state['frames'])} frames",
        expected=f"at least {FEWEST} frames, better 20 or more",
        fix=f"take more a second, such as --rate {rate:.1f}, into another folder; or film for longer",
    )
