"""Clean photographs to draw rain on, and which of them are kept for validation."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.scene.images import Image, image_size, list_images, read_image, resize_area, to_uint8

HELD_OUT_EVERY = 10  # of the photographs in order of name, the first, the eleventh and so on
LONG_SIDES = (480, 384)  # of the frames that rain is drawn for: about the size of the benchmark's views
ASPECT = 1.5  # of every frame

Frame = tuple[int, int]  # width and height in pixels
Bytes = NDArray[np.uint8]  # [H, W, 3], sRGB-encoded


@dataclass(frozen=True)
class Split:
    """Files of photographs."""

    training: tuple[Path, ...]
    held_out: tuple[Path, ...]


def split_photographs(folder: Path) -> Split:
    """The photographs of a folder, every HELD_OUT_EVERY-th by name held out.

    Raises:
        InputError: no such folder, or fewer than two photographs in it.
    """
    files = list_images(folder) if folder.is_dir() else []
    if len(files) < 2:
        raise InputError(
            f"{folder}: no photographs to learn from",
            found=f"{len(files)} pictures" if folder.is_dir() else "no such folder",
            expected="a folder of clean photographs, at least two",
        )
    held_out = tuple(files[::HELD_OUT_EVERY])
    return Split(tuple(file for file in files if file not in held_out), held_out)


def frame_of(width: int, height: int, long_side: int) -> Frame:
    """The frame for a photograph of this size: landscape or portrait."""
    short_side = round(long_side / ASPECT)
    return (long_side, short_side) if width >= height else (short_side, long_side)


def frames(sides: Sequence[int] = LONG_SIDES) -> tuple[Frame, ...]:
    """Landscape and portrait of these long sides."""
    return tuple(frame_of(*shape, side) for side in sides for shape in ((2, 1), (1, 2)))


def fit_frame(image: Image, frame: Frame) -> Image:
    """The middle of a photograph [H, W, 3] in the frame's shape, averaged down to its size.

    Raises:
        ValueError: the photograph is smaller than the frame.
    """
    height, width = image.shape[:2]
    scale = min(width / frame[0], height / frame[1])
    cut_width, cut_height = round(frame[0] * scale), round(frame[1] * scale)
    left, top = (width - cut_width) // 2, (height - cut_height) // 2
    return resize_area(np.ascontiguousarray(image[top : top + cut_height, left : left + cut_width]), *frame)


def read_photographs(files: Sequence[Path], sides: Sequence[int] = LONG_SIDES) -> list[dict[int, Bytes]]:
    """Every photograph in its frames of those long sides that it is large enough for, by long side, in 8 bits.

    Raises:
        InputError: a file is no picture, or smaller than the smallest frame.
    """
    photographs = []
    for file in tqdm(files, desc="photographs", unit="picture", leave=False):
        size = image_size(file)
        wanted = {side: frame_of(*size, side) for side in sides}
        fitting = {side: frame for side, frame in wanted.items() if size[0] >= frame[0] and size[1] >= frame[1]}
        if not fitting:
            smallest = min(wanted.values())
            raise InputError(
                f"{file}: too small to draw rain on",
                found=f"{size[0]}x{size[1]}",
                expected=f"at least {smallest[0]}x{smallest[1]}",
                fix="take it out of the folder",
            )
        image = read_image(file)
        photographs.append({side: to_uint8(fit_frame(image, frame)) for side, frame in fitting.items()})
    return photographs
