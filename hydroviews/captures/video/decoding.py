"""Video files, frame by frame, with PyAV: ffmpeg's libraries, which say all that a film says of itself."""

import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from hydroviews.captures.video.colours import to_pixels
from hydroviews.errors import InputError
from hydroviews.formats.photographs import UNREAD, require_permission
from hydroviews.scene.file_kinds import ARCHIVES, file_kind

if TYPE_CHECKING:  # not every command decodes films
    import av
    import av.container
    import av.video.stream

WHOLE = 0.98  # share of readable frames below which a video counts as cut short


class Video(NamedTuple):
    """An open video."""

    container: "av.container.InputContainer"
    stream: "av.video.stream.VideoStream"
    path: Path
    rate: float  # frames a second by its header; 0 if it does not say
    length: int  # frames by its header; 0 if it does not say


@dataclass(frozen=True)
class Frame:
    """A decoded frame of a video."""

    time: float  # seconds from the first one
    decoded: "av.VideoFrame"
    pixel_aspect: float  # width over height of a stored pixel

    @cached_property
    def pixels(self) -> NDArray[np.uint8]:
        """Upright and with square pixels, as players show it: uint8 [H, W, 3], RGB, sRGB-encoded."""
        pixels = to_pixels(self.decoded)
        height, width = pixels.shape[:2]
        if self.pixel_aspect != 1:
            size = max(1, round(width * self.pixel_aspect)), height
            how = cv2.INTER_CUBIC if self.pixel_aspect > 1 else cv2.INTER_AREA
            pixels = np.asarray(cv2.resize(pixels, size, interpolation=how), np.uint8)
        return np.ascontiguousarray(np.rot90(pixels, round(self.decoded.rotation / 90)))


@contextmanager
def open_video(path: Path) -> Iterator[Video]:
    """Open a video; of several video streams, one that is no cover picture.

    Raises:
        InputError: no such file, one that may not be read, a picture, or not a video; or nothing here decodes it.
    """
    if path.is_dir():
        fix = f"hydroviews poses {shlex.quote(str(path))} for a folder of photographs"
        raise InputError(f"{path}: a folder, not a film", fix=fix)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    require_permission(path)
    if ARCHIVES in file_kind(path):
        raise InputError(f"{path}: an archive, not a film", found=file_kind(path), fix="unpack it, and give its folder")
    if _is_picture(path):
        raise InputError(f"{path}: a picture, not a film", fix="name the folder that all photographs are in")
    import av

    try:
        container = av.open(os.path.abspath(path))  # it takes "12:30.mp4" for protocol 12
    except (av.error.FFmpegError, ValueError) as error:
        raise _unreadable(path) from error
    with container:
        films = [one for one in container.streams.video if not one.disposition & av.stream.Disposition.attached_pic]
        stream = next(iter(films), None)
        if stream is None:
            raise _unreadable(path)
        if stream.codec_context is None:
            raise InputError(
                f"{path}: nothing here decodes it",
                found="a film of an unknown or rare kind",
                fix=f"convert it: ffmpeg -i {shlex.quote(path.name)} -crf 12 film.mp4",
            )
        stream.thread_type = "AUTO"
        rate = float(stream.average_rate or stream.guessed_rate or 0)
        yield Video(container, stream, path, rate if 0 < rate < 1e4 else 0.0, _length(container, stream, rate))


def _length(container: "av.container.InputContainer", stream: "av.video.stream.VideoStream", rate: float) -> int:
    """Frames by the header: counted there, or by its duration; 0 if it does not say."""
    seconds = 0.0
    if stream.duration and stream.time_base:
        seconds = float(stream.duration * stream.time_base)
    elif container.duration:
        seconds = container.duration / 1e6
    count = stream.frames or round(seconds * rate)
    return count if 0 < count < 1e9 else 0


def _unreadable(path: Path) -> InputError:
    return InputError(
        f"{path}: cannot be read as a video",
        found=f"{path.stat().st_size} bytes",
        expected="a video file, such as .mp4, .mov, .mkv or .avi",
        fix="copy it again if it may be cut short; convert it with ffmpeg if it is of a rare kind",
    )


def _is_picture(path: Path) -> bool:
    """Whether a file is a picture that stands still; ffmpeg would take it for a film of one frame."""
    try:
        with PIL.Image.open(path) as picture:
            return getattr(picture, "n_frames", 1) == 1
    except (OSError, ValueError, PIL.Image.DecompressionBombError):
        return path.suffix.lower() in set(UNREAD) - {".gif"}


def video_frames(video: Video) -> Iterator[Frame]:
    """A video's frames, with seconds from the first one by the video's time stamps where it has any.

    Frames that are damaged are passed over. Interlaced ones are deinterlaced.

    Raises:
        InputError: it has neither time stamps nor a frame rate.
    """
    aspect = float(video.stream.sample_aspect_ratio or video.stream.codec_context.sample_aspect_ratio or 1)
    aspect = aspect if 0.1 < aspect < 10 else 1.0
    first = last = None
    for decoded in _progressive(video):
        stamp = None if decoded.time is None else float(decoded.time)
        if first is None or last is None:
            first, last = stamp or 0.0, 0.0
        elif stamp is not None and stamp - first > last:
            last = stamp - first
        elif video.rate:
            last += 1 / video.rate
        else:
            raise InputError(f"{video.path}: neither time stamps nor a frame rate", fix="convert it with ffmpeg")
        yield Frame(last, decoded, aspect)


def _progressive(video: Video) -> Iterator["av.VideoFrame"]:
    """The decoded frames; from the first interlaced one on, both fields of a frame become one picture (bwdif)."""
    import av

    graph = None
    for frame in _decoded(video):
        if graph is None and frame.interlaced_frame:
            graph = _deinterlacing(video.stream)
        if graph is None:
            yield frame
            continue
        graph.vpush(frame)
        yield from _pulled(graph)
    if graph is not None:
        with suppress(av.error.FFmpegError, EOFError):
            graph.vpush(None)
        yield from _pulled(graph)


def _deinterlacing(stream: "av.video.stream.VideoStream") -> "av.filter.Graph":
    import av.filter

    graph = av.filter.Graph()
    source = graph.add_buffer(template=stream)
    fields = graph.add("bwdif", "mode=send_frame:deint=interlaced")
    sink = graph.add("buffersink")
    source.link_to(fields)
    fields.link_to(sink)
    graph.configure()
    return graph


def _pulled(graph: "av.filter.Graph") -> Iterator["av.VideoFrame"]:
    """What a graph has ready."""
    import av

    with suppress(av.error.BlockingIOError, av.error.EOFError):
        while True:
            yield graph.vpull()


def _decoded(video: Video) -> Iterator["av.VideoFrame"]:
    """The frames as they are stored, without those that cannot be decoded."""
    import av

    packets = video.container.demux(video.stream)
    while True:
        try:
            packet = next(packets, None)
        except av.error.FFmpegError:  # what follows cannot be found any more
            packet = None
        if packet is None:
            return
        with suppress(av.error.FFmpegError):
            yield from packet.decode()


def is_cut_short(video: Video, frames: int) -> bool:
    """Whether so many fewer frames can be read than the header says that the video is damaged.

    Or that it was trimmed without being encoded anew: all frames are still in the file then.
    """
    return frames < WHOLE * video.length
