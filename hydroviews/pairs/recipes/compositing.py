"""The values in which rain is mixed with a picture: linear light, encoded values, or anything in between."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import Image, to_linear, to_srgb

LINEAR_SHARE, ENCODED_SHARE = 0.45, 0.3  # of the spaces drawn; the others lie in between
STEEPEST = 2.4  # exponent


@dataclass(frozen=True)
class Space:
    """A power of encoded values; linear light is sRGB's own."""

    gamma: float = 1.0  # exponent, 1 to STEEPEST
    linear: bool = False  # linear light instead

    def decoded(self, picture: NDArray) -> Image:
        """Values of this space for encoded ones, of any shape, both [0, 1]."""
        if self.linear:
            return to_linear(picture)
        return _power(picture, self.gamma)

    def encoded(self, values: NDArray) -> Image:
        """Encoded values [0, 1] for those of this space, which are clipped."""
        if self.linear:
            return to_srgb(values)
        return _power(np.clip(values, 0, 1), 1 / self.gamma)


LINEAR, ENCODED = Space(linear=True), Space()


def draw_space(rng: np.random.Generator) -> Space:
    """Linear light, encoded values, or a space in between."""
    chance = float(rng.uniform())
    if chance < LINEAR_SHARE:
        return LINEAR
    return ENCODED if chance < LINEAR_SHARE + ENCODED_SHARE else Space(float(rng.uniform(1, STEEPEST)))


def put_over(scene: Image, cover: NDArray[np.float32], light: NDArray[np.float32], screen: bool) -> Image:
    """Rain over a scene [H, W, 3], all in one space.

    Args:
        scene: [0, 1].
        cover: [H, W, 1], the share of the scene's light that rain blocks; a screen blocks as much as it shines.
        light: [H, W, 3], of the rain, times its cover.
        screen: 1 - (1 - scene) (1 - light), for bright rain, instead of (1 - cover) scene + light.
    """
    return scene + light * (1 - scene) if screen else scene * (1 - cover) + light


def _power(values: NDArray, exponent: float) -> Image:
    values = np.ascontiguousarray(values, np.float32)
    if exponent == 1:
        return values
    return np.asarray(cv2.pow(values, exponent), np.float32).reshape(values.shape)
