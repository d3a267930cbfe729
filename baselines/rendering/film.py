"""A film of a trained scene: a camera on a smooth path, rendered with the method itself."""

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
from tqdm import tqdm

from baselines.method import Method, check_render
from baselines.rendering.camera_paths import camera_path
from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.files.settings_guard import claim_folder
from hydroviews.files.temporary import remove_tree
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import read_image, to_uint8, write_png
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

CODECS = {".mp4": "vp09", ".webm": "VP90"}  # VP9, which browsers play and every OpenCV wheel can write
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
    remove_tree(frames)
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
    """Encode numbered PNGs as VP9.

    Raises:
        InputError: another suffix than .mp4 and .webm, an OpenCV without that encoder, or a full disk.
    """
    height, width = read_image(_frame(frames, 0)).shape[:2]
    with replacing(out) as temporary:
        writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*codec_of(out)), fps, (width, height))
        if not writer.isOpened():
            raise InputError(
                f"{out}: cannot be encoded",
                found=f"an OpenCV {cv2.__version__} without VP9",
                expected="the opencv-contrib-python-headless of constraints.txt",
                fix=f"make setup, or encode the frames in {frames} with another program",
            )
        for index in tqdm(range(n), desc="encoding", unit="frame"):
            writer.write(to_uint8(read_image(_frame(frames, index)))[..., ::-1])
        writer.release()
        whole = count_frames(temporary)
        if whole != n:  # OpenCV's writer tells nobody of a full disk
            raise InputError(
                f"{out}: not written whole",
                found=f"{whole} of {n} frames",
                fix=f"free some space and run the same command again; the frames in {frames} are kept",
            )


def count_frames(film: Path) -> int:
    """How many frames of a film can be read."""
    capture, count = cv2.VideoCapture(str(film)), 0
    while capture.grab():
        count += 1
    capture.release()
    return count


def codec_of(out: Path) -> str:
    """OpenCV's name of the codec for a file.

    Raises:
        InputError: another suffix than .mp4 and .webm.
    """
    if out.suffix.lower() not in CODECS:
        raise InputError(f"--out {out}: not a kind of film", expected=f"a name that ends in {' or '.join(CODECS)}")
    return CODECS[out.suffix.lower()]


def _frame(folder: Path, index: int) -> Path:
    return folder / f"{index:05d}.png"
