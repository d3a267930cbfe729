"""What rendered images are compared with: the seam where a method puts its own idea of rain."""

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.splatting.photometric import Target, photometric_loss, prepare
from baselines.splatting.rasterizer import Workspace
from hydroviews.images import Image, to_uint8
from hydroviews.masks import Ignored
from hydroviews.scenes import View

PREPARED_BYTES = 2 * 10**9  # filtered targets are kept up to this size in all


def read_images(views: Sequence[View]) -> "TrainingImages":
    """Read the pictures and masks of all views, showing progress.

    Raises:
        InputError: a picture or mask that cannot be read or has another size than its camera.
    """
    progress = tqdm(views, desc="reading images", unit="image", leave=False)
    return TrainingImages([to_uint8(view.image()) for view in progress], [view.ignored() for view in views])


class TrainingImages:
    """The training photographs [H, W, 3], kept with 8 bits a channel, and the targets made from them.

    Of each, the pixels of its mask [H, W], if it has one, are hidden: their values are not kept.
    """

    def __init__(self, pixels: Sequence[NDArray[np.uint8]], ignored: Sequence[Ignored | None] = ()):
        self._ignored = tuple(ignored) or (None,) * len(pixels)
        self._pixels = [
            image if mask is None else np.where(mask[..., None], np.uint8(0), image)
            for image, mask in zip(pixels, self._ignored, strict=True)
        ]
        prepared = 3 * 4 * sum(p.size for p in pixels)
        self._targets: list[Target | None] | None = [None] * len(pixels) if prepared <= PREPARED_BYTES else None

    def __len__(self) -> int:
        return len(self._pixels)

    def pixels(self, index: int) -> NDArray[np.uint8]:
        """One picture [H, W, 3]."""
        return self._pixels[index]

    def ignored(self, index: int) -> Ignored | None:
        """What is hidden of one picture, bool [H, W]; None where nothing is."""
        return self._ignored[index]

    def target(self, index: int) -> Target:
        """One picture as the loss wants it; kept if all of them fit."""
        if self._targets is None:
            return prepare(self._pixels[index], self._ignored[index])
        target = self._targets[index]
        if target is None:
            target = self._targets[index] = prepare(self._pixels[index], self._ignored[index])
        return target

    def digest(self) -> str:
        """SHA-256 of all pixels, and of what is hidden of them."""
        digest = hashlib.sha256()
        for pixels, ignored in zip(self._pixels, self._ignored, strict=True):
            digest.update(pixels.tobytes() + (b"" if ignored is None else ignored.tobytes()))
        return digest.hexdigest()


class Objective:
    """The photometric loss against the photographs. Methods derive from it to change what is compared, and how.

    Whatever a derived class learns on the way it returns from `arrays` and takes back in `restore`, so that
    checkpoints hold it.
    """

    def __init__(self, images: TrainingImages, ssim_share: float = 0.2):
        self.images = images
        self.ssim_share = ssim_share

    def __call__(self, image: Image, view: int, iteration: int, workspace: Workspace) -> tuple[float, Image]:
        """The loss of a rendered training view and its gradient by the image, both [H, W, 3]."""
        return photometric_loss(image, self.images.target(view), self.ssim_share, workspace=workspace)

    def about(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is refused."""
        return {"name": type(self).__name__, "ssim_share": self.ssim_share}

    def arrays(self) -> dict[str, NDArray]:
        """What has been learnt beside the Gaussians."""
        return {}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
