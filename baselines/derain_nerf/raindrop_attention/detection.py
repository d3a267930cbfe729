"""Find the drops in a picture of any size, and take them out."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.derain_nerf.raindrop_attention.network import DerainGenerator, full_size
from hydroviews.scene.images import Image


class Found(NamedTuple):
    """What a generator finds in a picture."""

    attention: NDArray[np.float32]  # [H, W], the last map, in (0, 1)
    derained: Image  # [H, W, 3], [0, 1]


def detect(image: Image, generator: DerainGenerator) -> Found:
    """Drops of a picture, and the picture without them.

    Args:
        image: float32 [H, W, 3], sRGB-encoded, [0, 1], of any size.
        generator: trained.

    Raises:
        ValueError: not [H, W, 3], or with values that are not finite.
    """
    if image.ndim != 3 or image.shape[2] != 3 or min(image.shape) < 1:
        raise ValueError(f"expected an image [H, W, 3], got shape {image.shape}")
    if not np.isfinite(image).all():
        raise ValueError("the image has values that are not finite")
    height, width = image.shape[:2]
    with torch.inference_mode():
        picture = continued(torch.from_numpy(np.ascontiguousarray(image, np.float32)), generator.multiple)
        maps, frames = generator(picture)
        planes = full_size(maps[-1], picture)[0], frames.whole[0].clamp(0, 1)
    attention, derained = (plane.permute(1, 2, 0)[:height, :width].contiguous().numpy() for plane in planes)
    return Found(attention[..., 0], derained)


def continued(image: Tensor, multiple: int) -> Tensor:
    """[H, W, 3] as [1, 3, H', W'], sides continued to multiples by repeating the last row and column."""
    height, width = image.shape[:2]
    picture = image.permute(2, 0, 1)[None]
    padded = functional.pad(picture, (0, -width % multiple, 0, -height % multiple), mode="replicate")
    return padded.contiguous(memory_format=torch.channels_last)
