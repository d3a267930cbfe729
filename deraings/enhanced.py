"""The training photographs with their rain taken out, each enhanced once and kept as a picture."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training_images import TrainingImages
from deraings.enhancement.enhance import enhance
from deraings.enhancement.weights import Enhancer
from hydroviews.images import read_image, to_uint8, write_png


class EnhancedViews:
    """The photographs enhanced, each when it is first asked for."""

    def __init__(self, images: TrainingImages, names: Sequence[str], enhancer: Enhancer, folder: Path) -> None:
        """Of training photographs.

        Args:
            images: the photographs.
            names: theirs, for the files.
            enhancer: the network.
            folder: where enhanced pictures are kept, apart for other photographs and other weights.
        """
        self._images, self._names, self._enhancer = images, names, enhancer
        self.digest = _fingerprint(images, enhancer)
        self._kept = folder / self.digest

    def file(self, index: int) -> Path:
        """One picture as a PNG, written unless an earlier call has finished it."""
        path = self._kept / f"{self._names[index]}.png"
        if not path.is_file():
            write_png(path, enhance(self._images.pixels(index).astype(np.float32) / 255, self._enhancer))
        return path

    def pixels(self, index: int) -> NDArray[np.uint8]:
        """One picture [H, W, 3].

        Raises:
            InputError: a kept picture is damaged.
        """
        return to_uint8(read_image(self.file(index)))


def enhanced_images(images: TrainingImages, names: Sequence[str], enhancer: Enhancer, folder: Path) -> TrainingImages:
    """Enhance every photograph, showing progress; arguments as of `EnhancedViews`. What is hidden stays hidden.

    Raises:
        InputError: a kept picture is damaged.
    """
    views = EnhancedViews(images, names, enhancer, folder)
    progress = tqdm(range(len(images)), desc="enhancing", unit="view", leave=False)
    return TrainingImages([views.pixels(i) for i in progress], [images.ignored(i) for i in range(len(images))])


def _fingerprint(images: TrainingImages, enhancer: Enhancer) -> str:
    digest = hashlib.sha256(images.digest().encode())
    for name, value in enhancer.network.state_dict().items():
        digest.update(name.encode() + value.numpy().tobytes())
    return digest.hexdigest()[:16]
