"""The photographs that methods learn from, as they are kept in memory."""

import hashlib
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.cli.threads import side_by_side
from hydroviews.errors import InputError
from hydroviews.scene.masks import Ignored, fit_ignored
from hydroviews.scene.scenes import View

Size = tuple[int, int]  # height and width


def read_images(views: Sequence[View]) -> "TrainingImages":
    """Read the pictures and masks of all views, two at a time, showing progress.

    Raises:
        InputError: a picture or mask that cannot be read or has another size than its camera; masks hide all pixels.
    """
    pictures = side_by_side(lambda view: (view.rounded(), view.ignored()), views)
    read = list(tqdm(pictures, desc="reading images", unit="image", total=len(views), leave=False))
    if read and all(ignored is not None and ignored.all() for _, ignored in read):
        raise InputError(
            "the training views: no pixel counts",
            found=f"masks that hide all of them, {views[0].mask} and the others",
            expected="masks that are black where a photograph is to be ignored, and white elsewhere",
            fix="invert the masks, or hide less of the photographs",
        )
    return TrainingImages([pixels for pixels, _ in read], [ignored for _, ignored in read])


def evenly_spread(count: int, most: int) -> list[int]:
    """Indices of at most `most` of `count` things in a row, first and last among them, as evenly as it goes."""
    places = np.linspace(0, max(count - 1, 0), min(most, count))
    return [int(place) for place in np.unique(places.round())]


class TrainingImages:
    """The training photographs [H, W, 3], kept with 8 bits a channel.

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

    def __len__(self) -> int:
        return len(self._full)

    def pixels(self, index: int, size: Size | None = None) -> NDArray[np.uint8]:
        """One picture [H, W, 3]."""
        return self._at(index, size)[0]

    def pixels_once(self, index: int, size: Size) -> NDArray[np.uint8]:
        """One picture at a size that nobody else asks for: the same pixels, which are not kept."""
        return _averaged(self._full[index][0], size)

    def ignored(self, index: int, size: Size | None = None) -> Ignored | None:
        """What is hidden of one picture, bool [H, W]; None where nothing is."""
        return self._at(index, size)[1]

    def all_pixels(self) -> NDArray[np.uint8]:
        """The pixels [N, 3] of one picture after the other, of which the pictures are parts from here on: no copy."""
        ends = np.cumsum([pixels.shape[0] * pixels.shape[1] for pixels, _ in self._full])
        whole = np.empty((ends[-1], 3), np.uint8)
        for index, end in enumerate(ends):  # one by one, so that all of them are never there twice
            pixels, ignored = self._full[index]
            part = whole[end - pixels.shape[0] * pixels.shape[1] : end].reshape(pixels.shape)
            part[...] = pixels
            self._full[index] = part, ignored
        return whole

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
            mask = None if ignored is None else fit_ignored(ignored, width, height)
            self._smaller[index, size] = _averaged(pixels, size), mask
        return self._smaller[index, size]


def _averaged(pixels: NDArray[np.uint8], size: Size) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(pixels, size[::-1], interpolation=cv2.INTER_AREA), np.uint8)
