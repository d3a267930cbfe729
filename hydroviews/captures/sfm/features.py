"""Features of photographs as arrays; those of SIFT are read from pycolmap's databases and written to them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray


@dataclass(frozen=True)
class Features:
    """Features of a view: keypoints [K, 2, 4 or 6], the first two their place in pixels, and descriptors.

    Descriptors of SIFT are uint8 [K, 128], learned ones float32 [K, 64] of length 1.
    """

    keypoints: NDArray[np.float32]
    descriptors: NDArray[np.uint8] | NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.keypoints)

    def where(self, kept: NDArray[np.bool_]) -> "Features":
        """Those of a mask [K]."""
        return Features(self.keypoints[kept], self.descriptors[kept])

    def strongest(self, count: int) -> "Features":
        """The first ones, where the strongest come first."""
        return Features(self.keypoints[:count], self.descriptors[:count])


def read_features(database: Path, names: Sequence[str]) -> list[Features]:
    """The features of images in a database."""
    with pycolmap.Database.open(database) as opened:
        ids = [image_id(opened, name) for name in names]
        return [Features(opened.read_keypoints(i), np.asarray(opened.read_descriptors(i).data)) for i in ids]


def write_features(database: Path, names: Sequence[str], features: Sequence[Features]) -> None:
    """Write features of those images in a database that have none."""
    sift = pycolmap.FeatureExtractorType.SIFT
    with pycolmap.Database.open(database) as opened:
        for name, one in zip(names, features, strict=True):
            image = image_id(opened, name)
            if not opened.exists_keypoints(image):
                opened.write_keypoints(image, one.keypoints)
            if not opened.exists_descriptors(image):
                opened.write_descriptors(image, pycolmap.FeatureDescriptors(type=sift, data=one.descriptors))


def image_id(opened: pycolmap.Database, name: str) -> int:
    """The number of an image in a database.

    Raises:
        ValueError: it is not in there.
    """
    image = opened.read_image_with_name(name)
    if image is None:
        raise ValueError(f"{name}: not in the database")
    return int(image.image_id)
