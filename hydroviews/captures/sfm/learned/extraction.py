"""Learned features of photographs, kept on disk one by one, without what masks hide."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.learned.xfeat import XFeat, working_size
from hydroviews.captures.sfm.matching import MAX_IMAGE_SIZE
from hydroviews.captures.sfm.rain import Enhance, read_enhanced
from hydroviews.files.atomic import replacing
from hydroviews.scene.images import Image, read_image
from hydroviews.scene.masks import find_mask, read_ignored

# Features of pictures of 320 pixels: twice as large gives a fifth more right matches in rain. More than 1024 are hardly
# better and cost four times as much to match; 512 are too few in drops.
ENLARGED = 2.0
DETECTED, KEPT = 2048, 1024


def extract(
    folder: Path,
    pictures: Path,
    names: Sequence[str],
    masks: Path | None = None,
    enhance: Enhance | None = None,
) -> list[Features]:
    """Detect features of pictures, the strongest of each first, unless they are in a folder already.

    Args:
        folder: gets a file for every picture.
        pictures: folder of the photographs.
        names: of all of them.
        masks: folder with a mask for every picture; no features are in hidden pixels.
        enhance: takes the rain out of a picture; features are those of the enhanced one.

    Returns:
        Up to `DETECTED` features of each.

    Raises:
        InputError: a picture that cannot be read, or is enhanced to another size; no weights.
    """
    missing = [name for name in names if not _file(folder, name).is_file()]
    network = XFeat(device()) if missing else None
    for name in tqdm(names, desc="features", unit="image"):
        if network is None or name not in missing:
            continue
        path = pictures / name
        found = detect(network, read_enhanced(path, enhance) if enhance else read_image(path))
        mask = find_mask(masks, name) if masks else None
        _write(_file(folder, name), found if mask is None else found.where(~_hidden(found, read_ignored(mask))))
    return [_read(_file(folder, name)) for name in names]


def detect(network: XFeat, image: Image) -> Features:
    """Features of a picture, the strongest first."""
    height, width = image.shape[:2]
    size = working_size(height, width, ENLARGED, MAX_IMAGE_SIZE)
    found = network.detect(torch.from_numpy(image.mean(-1)), size, DETECTED)
    return Features(found.places.numpy(), found.descriptors.numpy())


def device() -> str:
    """Where networks run: on the GPU if there is one, unless $HYDROVIEWS_DEVICE is cpu."""
    return "cuda" if os.environ.get("HYDROVIEWS_DEVICE") != "cpu" and torch.cuda.is_available() else "cpu"


def _hidden(features: Features, ignored: np.ndarray) -> np.ndarray:
    """Which features [K] lie in hidden pixels of a mask [H, W]."""
    pixels = np.minimum(features.keypoints.astype(int), np.array(ignored.shape[::-1]) - 1)
    return np.asarray(ignored[pixels[:, 1], pixels[:, 0]])


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.features.npz"


def _write(path: Path, features: Features) -> None:
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, keypoints=features.keypoints, descriptors=features.descriptors)


def _read(path: Path) -> Features:
    with np.load(path) as stored:
        return Features(stored["keypoints"], stored["descriptors"])
