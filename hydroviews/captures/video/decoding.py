"""Video files, frame by frame, with OpenCV's ffmpeg."""

import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import cv2
import PIL.Image

from hydroviews.errors import InputError
from hydroviews.formats.photographs import UNREAD, require_permission

LOG_ERRORS = 2  # OpenCV's level without warnings
WHOLE = 0.98  # share of readable frames below which a video counts as cut short


class Video(NamedTuple):
    """An open video."""

    capture: cv2.VideoCapture
    path: Path
    rate: float  # frames a second by its header; 0 if it does not say
    length: int  # frames by its header; 0 if it does not say


@contextmanager
def open_video(path: Path) -> Iterator[Video]:
    """Open a video; its frames are turned upright by the orientation in its header.

    Raises:
        InputError: no such file, one that may not be read, a picture, or not a video.
    """
    if path.is_dir():
        fix = f"python -m hydroviews poses {shlex.quote(str(path))} for a folder of photographs"
        raise InputError(f"{path}: a folder, not a film", fix=fix)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    require_permission(path)
    if _is_picture(path):
        raise InputError(f"{path}: a picture, not a film", fix="name the folder that all photographs are in")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # InputError below replaces its messages, and OpenCV's own
    cv2.setLogLevel(LOG_ERRORS)
    capture = cv2.VideoCapture(os.path.abspath(path), cv2.CAP_FFMPEG)  # it takes "12:30.mp4" for protocol 12
    try:
        if not capture.isOpened():
            raise InputError(
                f"{path}: cannot be read as a video",
                found=f"{path.stat().st_size} bytes",
                expected="a video file, such as .mp4, .mov, .mkv or .avi",
                fix="copy it again if it may be cut short; convert it with ffmpeg if it is of a rare kind",
            )
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        yield Video(capture, path, rate if 0 < rate < 1e4 else 0.0, int(count) if 0 < count < 1e9 else 0)
    finally:
        capture.release()


def _is_picture(path: Path) -> bool:
    """Whether a file is a picture that stands still; ffmpeg would take it for a film of one frame."""
    try:
        with PIL.Image.open(path) as picture:
            return getattr(picture, "n_frames", 1) == 1
    except (OSError, ValueError, PIL.Image.DecompressionBombError):
        return path.suffix.lower() in set(UNREAD) - {".gif"}


def frame_times(video: Video) -> Iterator[float]:
    """Step through a video's frames, yielding seconds from the first one, by the video's time stamps where it has any.

    Raises:
        InputError: it has neither time stamps nor a frame rate.
    """
    first = last = None
    while video.capture.grab():
        stamp = video.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if first is None or last is None:
            first, last = stamp, 0.0
        elif stamp - first > last:
            last = stamp - first
        elif video.rate:
            last += 1 / video.rate
        else:
            raise InputError(f"{video.path}: neither time stamps nor a frame rate", fix="convert it with ffmpeg")
        yield last


def is_cut_short(video: Video, frames: int) -> bool:
    """Whether so many fewer frames can be read than the header says that the video is damaged.

    Or that it was trimmed without being encoded anew: all frames are still in the file then.
    """
    return frames < WHOLE * video.length
