"""Frames of a video as PNG files: at regular times ("instants"), the sharpest one near each.

    <out>/video.json       the video and the settings
    <out>/frames.json      time and sharpness of each frame
    <out>/images/*.png     frame-00000.png is the one near the first instant

A call resumes where an interrupted one ended; other settings or another video in the same folder are refused.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.captures.video.decoding import Video, is_cut_short, open_video, video_frames
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import is_there, read_json, sha256, write_json
from hydroviews.files.settings_guard import claim_folder
from hydroviews.profiles import require_long_side
from hydroviews.scene.images import without_streaks, write_png
from hydroviews.scene.masks import MASKS, mask_name

SETTINGS, FILE, IMAGES = "video.json", "frames.json", "images"
NEAR = 0.25  # seconds before and after an instant in which the sharpest frame is chosen, but at most
SHARE = 0.45  # of the time between two instants
ANALYSED_SIDE = 480  # pixels: sharpness is measured at this size
FEWEST = 3  # frames that a scene needs

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class FrameChoice:
    """Which frames are taken, and at which size."""

    rate: float = 1.0  # frames a second
    long_side: int | None = None  # pixels; a video is never enlarged

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise InputError(f"--rate {self.rate}: no rate", expected="frames a second, more than 0")
        require_long_side(self.long_side)


@dataclass
class Progress:
    """How much of a video has been read."""

    frames: int = 0
    seconds: float = 0.0


class Candidate(NamedTuple):
    """A frame that may be taken."""

    instant: int  # index of the nearest instant, from 0
    time: float  # seconds from the video's beginning
    sharpness: float
    pixels: Pixels  # [H, W, 3], RGB


def sharpness(pixels: Pixels) -> float:
    """Mean squared gradient of the grey picture without upright streaks; larger for sharper pictures.

    In 106 of 110 pairs it prefers a sharp rainy picture to one that is blurred by 3 to 9 of 800 pixels and has a third
    more rain, and rain alone changes it by 3 %. The variance of the Laplacian: 102 pairs, 13 %.

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
    """Write the sharpest frame near each instant; there are `choice.rate` instants a second, from the first frame on.

    Args:
        path: the video.
        out: gets `frames.json` and `images`.
        choice: which and how large.

    Returns:
        Warnings about the video; none where all is well.

    Raises:
        InputError: not a video, damaged or too short, no frame can be read, or `out` holds frames of another one.
    """
    with open_video(path) as video:
        source = {"video": path.name, "bytes": path.stat().st_size, "sha256": sha256(path)}
        claim_folder(
            out / SETTINGS,
            {**source, **asdict(choice)},
            taken="holds frames of another video, or taken otherwise",
            foreign="holds files that no video was taken to",
            fix="choose another --out, or remove that folder",
            ignored=("video",),
        )
        state: dict[str, Any] = read_json(out / FILE) if is_there(out / FILE) else {}
        if not state or not all((out / IMAGES / frame["name"]).is_file() for frame in state["frames"]):
            state = _take(video, out, choice)
        if len(state["frames"]) < FEWEST:
            raise _too_few_frames(video, choice, state)
    return list(state["notes"])


def _take(video: Video, out: Path, choice: FrameChoice) -> dict[str, Any]:
    """Go through the video and write the frames that are missing; returns the content of `frames.json`."""
    frames, seen = [], Progress()
    for best in _best_frames(video, choice, seen):
        name = f"frame-{best.instant:05d}.png"
        if not (out / IMAGES / name).is_file():
            ownership.remove(out / MASKS / mask_name(name))  # nothing is hidden in the new picture
            write_png(out / IMAGES / name, _fitted(best.pixels, choice.long_side))
        facts = {"instant": best.instant / choice.rate, "time": best.time, "sharpness": best.sharpness}
        frames.append({"name": name, **{key: round(value, 4) for key, value in facts.items()}})
    state = {
        "seconds": round(seen.seconds + (1 / video.rate if video.rate else 0.0), 3),
        "frames_in_video": seen.frames,
        "notes": _notes(video, choice, seen, len(frames)),
        "frames": frames,
    }
    if not frames:
        raise InputError(f"{video.path}: not one frame can be read", fix="copy the video again, or convert it")
    write_json(out / FILE, state)
    return state


def _best_frames(video: Video, choice: FrameChoice, seen: Progress) -> Iterator[Candidate]:
    """The sharpest frame near each instant that has one; `seen` is updated with each frame read."""
    near = min(NEAR, SHARE / choice.rate)
    best: Candidate | None = None
    bar = tqdm(total=video.length or None, desc="frames", unit="frame")
    for frame in video_frames(video):
        time = frame.time
        seen.frames, seen.seconds = seen.frames + 1, time
        bar.update()
        instant = round(time * choice.rate)
        if abs(time - instant / choice.rate) > near:
            continue
        value = sharpness(frame.pixels)
        if best is not None and best.instant != instant:
            yield best
            best = None
        if best is None or value > best.sharpness:
            best = Candidate(instant, time, value, frame.pixels)
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


def _notes(video: Video, choice: FrameChoice, seen: Progress, taken: int) -> list[str]:
    notes = []
    if is_cut_short(video, seen.frames):
        read = f"{seen.frames} of its {video.length} frames could be read"
        notes.append(f"{video.path.name} is cut short or was trimmed: {read}")
    wanted = int(seen.seconds * choice.rate) + 1
    if taken < wanted:
        notes.append(f"{wanted - taken} of {wanted} instants have no frame near them: the video has too few a second")
    return notes


def _too_few_frames(video: Video, choice: FrameChoice, state: dict[str, Any]) -> InputError:
    seconds, taken = state["seconds"], len(state["frames"])
    expected = f"at least {FEWEST} frames, better 20 or more"
    more = f"take more a second, such as --rate {20 / seconds if seconds else 0.0:.1f}, into another folder"
    if is_cut_short(video, state["frames_in_video"]):
        return InputError(
            f"{video.path}: damaged or trimmed after {seconds:.1f} s",
            found=f"{state['frames_in_video']} of its {video.length} frames can be read, which gives {taken}",
            expected=expected,
            fix=f"if it was trimmed, {more}; if not, copy it again, or let ffmpeg try to mend it",
        )
    return InputError(
        f"{video.path}: too short at a rate of {choice.rate:g} a second",
        found=f"{seconds:.1f} s, which gives {taken} frames",
        expected=expected,
        fix=f"{more}; or film for longer",
    )
