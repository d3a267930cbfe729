"""What was added to a view, kept as half-float OpenEXR: channels by name, each [H, W]."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing


def write_layers(path: Path, channels: Mapping[str, NDArray]) -> None:
    """Write planes [H, W] as one half-float EXR with lossless compression.

    Raises:
        InputError: the disk is full.
    """
    planes = {name: np.ascontiguousarray(plane, np.float16) for name, plane in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with replacing(path) as temporary:
        OpenEXR.File(header, planes).write(str(temporary))


def read_layers(path: Path) -> dict[str, NDArray[np.float32]]:
    """Read the planes that `write_layers` wrote, as float32.

    Raises:
        InputError: missing, cut short, or not an EXR.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such layer", fix="build the variant again")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:  # the library raises RuntimeError, TypeError or its own types by version
        raise InputError(
            f"{path}: not a readable EXR layer",
            found=f"{path.stat().st_size} bytes; {error}",
            fix="delete the file and build again; it may be cut short",
        ) from error
