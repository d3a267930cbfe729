"""What rendered images are compared with: the seam where a method puts its own idea of rain."""

import hashlib
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.splatting.appearance import Appearance
from baselines.splatting.photometric import Target, photometric_loss, prepare
from baselines.splatting.rasterizer import Workspace
from hydroviews.images import Image, to_uint8
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


class Objective:
    """The photometric loss against the photographs. Methods derive from it to change what is compared, and how.

    Whatever a derived class learns on the way it returns from `arrays` and takes back in `restore`, so that
    checkpoints hold it.
    """

    def __init__(self, images: TrainingImages, ssim_share: float = 0.2, appearance: Appearance | None = None):
        self.images = images
        self.ssim_share = ssim_share
        self.appearance = appearance  # what gives Gaussians their colours, where it is not spherical harmonics alone

    def compare(
        self, images: Sequence[Image], view: int, iteration: int, workspace: Workspace
    ) -> tuple[float, Sequence[Image]]:
        """The loss of a view's looks, in the order of `Appearance.looks`, and its gradients by each of them."""
        loss, gradient = self(images[0], view, iteration, workspace)
        return loss, [gradient, *(np.zeros_like(image) for image in images[1:])]

    def __call__(self, image: Image, view: int, iteration: int, workspace: Workspace) -> tuple[float, Image]:
        """The loss of a rendered training view, at its own size or a smaller one, and its gradient by the image.

        Args:
            image: rendered, [H, W, 3]; so is the gradient.
            view: index of the training view.
            iteration: of the training.
            workspace: buffers to reuse.
        """
        target = self.images.target(view, (image.shape[0], image.shape[1]))
        return photometric_loss(image, target, self.ssim_share, workspace=workspace)

    def residual(self, image: Image, view: int, workspace: Workspace) -> float:
        """The loss of a rendered view that is only looked at; learns nothing from it."""
        return photometric_loss(image, self.images.target(view), self.ssim_share, workspace=workspace)[0]

    def about(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is refused."""
        settings = {"name": type(self).__name__, "ssim_share": self.ssim_share}
        return settings if self.appearance is None else {**settings, "appearance": self.appearance.about()}

    def arrays(self) -> dict[str, NDArray]:
        """What has been learnt beside the Gaussians."""
        learnt = {} if self.appearance is None else self.appearance.arrays()
        return {f"appearance.{name}": value for name, value in learnt.items()}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
        if self.appearance is not None:
            start = "appearance."
            self.appearance.restore({k.removeprefix(start): v for k, v in arrays.items() if k.startswith(start)})
