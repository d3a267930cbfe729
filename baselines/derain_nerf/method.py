"""DerainNeRF (Li et al. 2024): a radiance field that learns nothing from the pixels where drops lie on the lens.

A network finds the drops of every photograph once (`raindrop_attention`: Qian et al. 2018, as in the paper). Where its
last attention map reaches a threshold a pixel is hidden, M = 1, and the field is trained with

    L = mean over rays of (1 - M) |C - C*|^2, for the coarse and for the fine rendering.

Rays are drawn over all pixels; those that are hidden count nothing. The network's other half, the photographs without
their drops, is not used: C* is the photograph as it was taken, as in the paper.

Where this deviates, beside what all radiance fields here share (docs/methods/radiance-fields.md): the map is widened
by one pixel of the photograph, whatever its size, since attention fades at the rims of drops, their darkest part; the
field is a hash grid in the short profiles, that of NeRF in `paper`; scenes that are seen from all sides are
contracted and not in normalised device coordinates, which have no room for them; no noise is added to densities.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.weights import find_weights, load_detector
from baselines.method import Citation, TrainingSummary
from baselines.training.images import TrainingImages
from baselines.volumetric.config import NERF, VolumetricConfig
from baselines.volumetric.method import RadianceMethod
from hydroviews.files.atomic import sha256
from hydroviews.scene.images import Image, resize_area
from hydroviews.scene.masks import Ignored, mask_name, read_ignored, write_ignored

MASKS = "drops"
LONGEST = 480  # largest side in pixels for detection, to which larger pictures are shrunk: as large as in its training


@dataclass(frozen=True)
class DropDetectionConfig:
    """How drops are detected."""

    weights: str = "small"  # weights of the network, by name or path
    threshold: float = 0.2  # smallest attention of a hidden pixel
    widened: int = 1  # pixels by which masks are widened on every side
    weights_sha256: str | None = None  # SHA-256 of the file of the weights


@dataclass(frozen=True)
class DerainNeRFConfig:
    """A field, and what it does not learn from."""

    volumetric: VolumetricConfig
    drops: DropDetectionConfig = field(default_factory=DropDetectionConfig)


# The released code's training: 200,000 steps of 1,024 rays, 64 and 64 samples, a tenth of the rate in 250,000 steps.
PAPER = replace(NERF, iterations=200_000, final_rate=0.1 ** (200 / 250))
PROFILES = {
    "demo": DerainNeRFConfig(VolumetricConfig(iterations=4500)),
    "standard": DerainNeRFConfig(VolumetricConfig(iterations=13_000)),
    "paper": DerainNeRFConfig(PAPER),
}


class DerainNeRF(RadianceMethod):
    """DerainNeRF (Li et al. 2024): a radiance field that ignores pixels with detected drops."""

    citation = Citation(
        title="DerainNeRF",
        paper="DerainNeRF: 3D Scene Estimation with Adhesive Waterdrop Removal",
        authors="Y. Li, J. Wu, L. Zhao, P. Liu",
        year=2024,
        link="https://arxiv.org/abs/2403.20013",
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def __init__(self, config: DerainNeRFConfig, seed: int) -> None:
        super().__init__(config, seed)
        self._masks: list[Ignored] = []  # of the training views, after `fit`

    @classmethod
    def configuration(cls, profile: str) -> DerainNeRFConfig:
        """See Method.

        Raises:
            InputError: no such profile, or no such weights.
        """
        config: DerainNeRFConfig = super().configuration(profile)
        drops = replace(config.drops, weights_sha256=sha256(find_weights(config.drops.weights)))
        return replace(config, drops=drops)

    def weights(self, images: TrainingImages, names: Sequence[str], folder: Path) -> Sequence[NDArray[np.float32]]:
        """See RadianceMethod; 1 - M, and M is kept in `folder` as pictures."""
        self._masks = drop_masks(images, names, self.config.drops, folder / MASKS)
        return [1 - mask.astype(np.float32) for mask in self._masks]

    def hidden(self, view: int, size: tuple[int, int]) -> NDArray[np.float32] | None:
        """See Method: M."""
        if not self._masks:
            return None
        mask = self._masks[view].astype(np.float32)
        return np.asarray(cv2.resize(mask, size[::-1], interpolation=cv2.INTER_AREA), np.float32)

    def summary(self) -> TrainingSummary:
        """See Method; `used` says how much of the photographs was hidden."""
        if not self._masks:
            return super().summary()
        share = float(np.mean(np.concatenate([mask.ravel() for mask in self._masks])))
        return replace(super().summary(), used=f"{share:.1%} of the pixels hidden as drops")


def drop_masks(
    images: TrainingImages, names: Sequence[str], config: DropDetectionConfig, folder: Path
) -> list[Ignored]:
    """What is hidden of every photograph, bool [H, W]; found once, and kept in `folder`.

    Args:
        images: the photographs.
        names: theirs, for the files.
        config: of the detection.
        folder: where masks are kept, apart for other photographs and other settings.

    Raises:
        InputError: no such weights, or a kept mask is damaged.
    """
    settings = repr((config.threshold, config.widened, LONGEST, sha256(find_weights(config.weights))))
    kept = folder / hashlib.sha256((images.digest() + settings).encode()).hexdigest()[:16]
    generator = load_detector(config.weights)
    progress = tqdm(names, desc="detecting drops", unit="view", leave=False)
    return [_mask(images.pixels(i), generator, config, kept / mask_name(name)) for i, name in enumerate(progress)]


def _mask(pixels: NDArray[np.uint8], generator: DerainGenerator, config: DropDetectionConfig, path: Path) -> Ignored:
    """One photograph's mask; read if an earlier call has finished it."""
    if not path.is_file():
        attention = attention_of(pixels.astype(np.float32) / 255, generator)
        write_ignored(path, hidden(attention, config))
    return read_ignored(path)


def attention_of(image: Image, generator: DerainGenerator, longest: int = LONGEST) -> NDArray[np.float32]:
    """The network's last map [H, W] of a picture [H, W, 3], at most `longest` pixels a side while detecting."""
    height, width = image.shape[:2]
    scale = min(1.0, longest / max(height, width))
    small = resize_area(image, max(1, round(width * scale)), max(1, round(height * scale)))
    found = detect(small, generator).attention
    return np.asarray(cv2.resize(found, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def hidden(attention: NDArray[np.float32], config: DropDetectionConfig) -> Ignored:
    """Attention [H, W] from the threshold on, widened."""
    found = (attention >= config.threshold).astype(np.uint8)
    side = 2 * config.widened + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(found, kernel) > 0)
