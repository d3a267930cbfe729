"""What a render is compared with, and which of its pixels count."""

from typing import NamedTuple

from deraings.image_planes import Plane
from hydroviews.scene.images import Image


class Observation(NamedTuple):
    """A training photograph, and which of its pixels count."""

    photograph: Image  # [H, W, 3]
    photographed: Plane | None  # [H, W], 0 where the photograph's mask hides it; None where nothing is hidden
    shown: Plane | None  # [H, W], the same, and 0 where the render is not finite
    weights: Plane | None  # [H, W] factors on each pixel's share of the loss; None where all are 1
