"""The training photographs with their rain taken out, each enhanced once and kept as a picture."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from baselines.splatting.objective import TrainingImages
from deraings.enhancement.enhance import enhance
from deraings.enhancement.weights import Enhancer
from hydroviews.images import read_image, to_uint8, write_png


def enhanced_images(images: TrainingImages, names: Sequence[str], enhancer: Enhancer, folder: Path) -> TrainingImages:
    """Enhance every photograph, showing progress; those that an earlier call finished are read.

    Args:
        images: the photographs; what is hidden of them stays hidden.
        names: theirs, for the files.
        enhancer: the network.
        folder: where enhanced pictures are kept, apart for other photographs and other weights.

    Raises:
        InputError: a kept picture is damaged.
    """
    kept = folder / _fingerprint(images, enhancer)
    pictures = []
    for index, name in enumerate(tqdm(names, desc="enhancing", unit="view", leave=False)):
        path = kept / f"{name}.png"
        if not path.is_file():
            write_png(path, enhance(images.pixels(index).astype(np.float32) / 255, enhancer))
        pictures.append(to_uint8(read_image(path)))
    return TrainingImages(pictures, [images.ignored(index) for index in range(len(images))])


def _fingerprint(images: TrainingImages, enhancer: Enhancer) -> str:
    digest = hashlib.sha256(images.digest().encode())
    for name, value in enhancer.network.state_dict().items():
        digest.update(name.encode() + value.numpy().tobytes())
    return digest.hexdigest()[:16]
