"""A film of a trained scene: a camera on a smooth path, rendered with the method itself."""

import logging
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from baselines.method import Method, check_render
from baselines.rendering.camera_paths import camera_path
from hydroviews.captures.video.decoding import open_video, video_frames
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import replacing
from hydroviews.files.settings_guard import claim_folder
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import read_image, to_uint8, write_png
from hydroviews.scene.scenes import Scene

if TYPE_CHECKING:  # not every command encodes films
    import av

logger = logging.getLogger(__name__)

SUFFIXES = (".mp4", ".webm")
CODEC = "libvpx-vp9"  # which browsers play and every wheel of PyAV can write
QUALITY = {"crf": "20", "b": "0", "deadline": "good", "cpu-used": "4"}
FRAMES, SETTINGS = "-frames", "film.json"
SIZES = (16, 4096)  # pixels
MOST_FRAMES = 100_000
CHECK = "make check says whether the method keeps its contract; train it again"


@dataclass(frozen=True)
class FilmChoice:
    """Length, frame rate and size of a film."""

    seconds: float = 8.0  # length of the film, once around the path
    fps: int = 30  # frames per second
    size: int = 800  # longer side in pixels

    def __post_init__(self) -> None:
        if not 1 <= self.fps <= 240:
            raise InputError(f"--fps {self.fps}: impossible", expected="1 to 240")
        if not math.isfinite(self.seconds) or not 2 <= self.n_frames <= MOST_FRAMES:
            raise InputError(f"--seconds {self.seconds:g}: impossible", expected=f"2 to {MOST_FRAMES} frames")
        if not SIZES[0] <= self.size <= SIZES[1]:
            raise InputError(f"--size {self.size}: impossible", expected=f"{SIZES[0]} to {SIZES[1]} pixels")

    @property
    def n_frames(self) -> int:
        """Frames of the film."""
        return round(self.seconds * self.fps)


def draw_film(
    method: Method, scene: Scene, out: Path, choice: FilmChoice, about: Mapping[str, Any], overwrite: bool = False
) -> None:
    """Render a camera path through a scene to a film; frames are kept beside it until it is whole.

    Args:
        method: trained.
        scene: whose training views the path follows.
        out: the film, .mp4 or .webm.
        choice: how long, how smooth, how large.
        about: JSON values that say of what it is: frames of something else are not mixed in.
        overwrite: drop the frames of another film that was broken off, instead of refusing them.

    Raises:
        InputError: another suffix, no encoder, or frames of another film are there.
    """
    cameras = [view.camera for view in scene.train_views]
    path = [fitted(camera, choice.size) for camera in camera_path(cameras, scene.points, choice.n_frames)]
    frames = out.with_name(out.stem + FRAMES)
    claim_folder(
        frames / SETTINGS,
        {**about, **vars(choice)},
        taken="holds frames of another film",
        foreign="is not a folder of frames",
        fix="choose another --out, or remove the folder",
        overwrite=overwrite,
        forget=lambda: logger.info("%s: frames of another film, which was broken off, are dropped", frames),
    )
    render_frames(method, path, frames)
    write_film(out, frames, len(path), choice.fps)
    if left := ownership.remove(frames):
        logger.warning("%s: not written by HydroViews, and kept: %s", frames, ownership.named(left, frames))
    first, size = path[0], out.stat().st_size / 1e6
    logger.info("%s: %d frames of %dx%d, %.1f MB", out, len(path), first.width, first.height, size)


def fitted(camera: Camera, size: int) -> Camera:
    """The camera with this many pixels along its longer side, enlarged if need be; both sides even, as films want."""
    factor = size / max(camera.width, camera.height)
    width, height = (max(2, 2 * round(side * factor / 2)) for side in (camera.width, camera.height))
    return camera.resized(width, height)


def render_frames(method: Method, path: list[Camera], folder: Path) -> None:
    """Render what is missing of a path into numbered PNGs.

    Raises:
        InputError: a render is not what the contract of methods promises.
    """
    for index, camera in enumerate(tqdm(path, desc="rendering", unit="frame")):
        if not _frame(folder, index).is_file():
            image = method.render(camera)
            try:
                check_render(image, camera)
            except ValueError as error:
                raise InputError(f"{type(method).__name__}, frame {index}: {error}", fix=CHECK) from error
            write_png(_frame(folder, index), image)


def write_film(out: Path, frames: Path, n: int, fps: int) -> None:
    """Encode numbered PNGs as VP9, with the tags of their colours: BT.709, limited range, the transfer of sRGB.

    Raises:
        InputError: another suffix than .mp4 and .webm, a PyAV without that encoder, or a full disk.
    """
    import av

    require_suffix(out)
    if CODEC not in av.codec.codecs_available:
        raise InputError(
            f"{out}: cannot be encoded",
            found=f"a PyAV {av.__version__} without {CODEC}",
            expected="the av of constraints.txt",
            fix=f"make setup, or encode the frames in {frames} with another program",
        )
    with replacing(out) as temporary:
        failure = ""
        try:
            _encode(temporary, [_frame(frames, index) for index in range(n)], fps)
        except av.error.FFmpegError as error:
            failure = f", {error.strerror}"
        whole = count_frames(temporary)
        if failure or whole != n:
            raise InputError(
                f"{out}: not written whole",
                found=f"{whole} of {n} frames{failure}",
                fix=f"free some space and run the same command again; the frames in {frames} are kept",
            )


def _encode(film: Path, pictures: list[Path], fps: int) -> None:
    import av

    with av.open(os.path.abspath(film), "w") as container:  # it takes "12:30.mp4" for protocol 12
        stream: Any = container.add_stream(CODEC, rate=fps, options=QUALITY)
        stream.height, stream.width = read_image(pictures[0]).shape[:2]
        stream.pix_fmt = "yuv420p"
        _tag(stream.codec_context)
        for index, frame in enumerate(_stored(tqdm(pictures, desc="encoding", unit="frame"))):
            frame.pts, frame.time_base = index, Fraction(1, fps)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _stored(pictures: Iterable[Path]) -> Iterator["av.VideoFrame"]:
    """Pictures as BT.709 in limited range, with half of the colour's resolution."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    for path in pictures:
        frame = av.VideoFrame.from_ndarray(to_uint8(read_image(path)), format="rgb24")
        stored = frame.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG)
        _tag(stored)
        yield stored


def _tag(of_film: Any) -> None:
    """Enter in a frame or an encoder which colours its numbers stand for."""
    from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

    of_film.colorspace, of_film.color_range = Colorspace.ITU709, ColorRange.MPEG
    of_film.color_primaries, of_film.color_trc = ColorPrimaries.BT709, ColorTrc.IEC61966_2_1


def count_frames(film: Path) -> int:
    """How many frames of a film can be read; 0 where there is no film."""
    try:
        with open_video(film) as video:
            return sum(1 for _ in video_frames(video))
    except InputError:
        return 0


def require_suffix(out: Path) -> None:
    """Refuse other kinds of films.

    Raises:
        InputError: another suffix than .mp4 and .webm.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise InputError(f"--out {out}: not a kind of film", expected=f"a name that ends in {' or '.join(SUFFIXES)}")


def _frame(folder: Path, index: int) -> Path:
    return folder / f"{index:05d}.png"
