"""The photographs that methods learn from, as they are kept in memory."""

import hashlib
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.splatting.photometric import Target, prepare
from hydroviews.images import to_uint8
from hydroviews.masks import Ignored, fit_ignored
from hydroviews.scenes import View

PREPARED_BYTES = 2 * 10**9  # filtered targets are kept up to this size in all
TARGET_PLANES = 3  # of the size of the picture in float32
Size = tuple[int, int]  # height and width


def read_images(views: Sequence[View]) -> "TrainingImages":
    """Read the pictures and masks of all views, showing progress.

    Raises:
        InputError: a picture or mask that cannot be read or has another size than its camera.
    """
    progress = tqdm(views, desc="reading images", unit="image", leave=False)
    return TrainingImages([to_uint8(view.image()) for view in progress], [view.ignored() for view in views])


class TrainingImages:
    """The training photographs [H, W, 3], kept with 8 bits a channel, and the targets made from them.

    Of each, the pixels of its mask [H, W], if it has one, are hidden: their values are not kept. Asked for at a
    smaller size (height, width), a picture is averaged over areas; a pixel that a hidden one touches is hidden.
    """

    def __init__(self, pixels: Sequence[NDArray[np.uint8]], ignored: Sequence[Ignored | None] = ()):
        masks = tuple(ignored) or (None,) * len(pixels)
        self._full = [
            (image if mask is None else np.where(mask[..., None], np.uint8(0), image), mask)
            for image, mask in zip(pixels, masks, strict=True)
        ]
        self._smaller: dict[tuple[int, Size], tuple[NDArray[np.uint8], Ignored | None]] = {}
        self._targets: dict[tuple[int, Size], Target] = {}
        self._room = PREPARED_BYTES

    def __len__(self) -> int:
        return len(self._full)

    def pixels(self, index: int, size: Size | None = None) -> NDArray[np.uint8]:
        """One picture [H, W, 3]."""
        return self._at(index, size)[0]

    def ignored(self, index: int, size: Size | None = None) -> Ignored | None:
        """What is hidden of one picture, bool [H, W]; None where nothing is."""
        return self._at(index, size)[1]

    def target(self, index: int, size: Size | None = None) -> Target:
        """One picture as the loss wants it; kept while there is room."""
        pixels, ignored = self._at(index, size)
        key = index, (pixels.shape[0], pixels.shape[1])
        target = self._targets.get(key)
        if target is None:
            target = prepare(pixels, ignored)
            needed = TARGET_PLANES * target.pixels.nbytes
            if needed <= self._room:
                self._room -= needed
                self._targets[key] = target
        return target

    def digest(self) -> str:
        """SHA-256 of all pixels, and of what is hidden of them."""
        digest = hashlib.sha256()
        for pixels, ignored in self._full:
            digest.update(pixels.tobytes() + (b"" if ignored is None else ignored.tobytes()))
        return digest.hexdigest()

    def _at(self, index: int, size: Size | None) -> tuple[NDArray[np.uint8], Ignored | None]:
        pixels, ignored = self._full[index]
        if size is None or size == pixels.shape[:2]:
            return pixels, ignored
        if (index, size) not in self._smaller:
            height, width = size
            averaged = np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
            mask = None if ignored is None else fit_ignored(ignored, width, height)
            self._smaller[index, size] = averaged, mask
        return self._smaller[index, size]
