"""What grows with distance and hides what is far: haze, and rain too fine or too far to be drawn."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import Image, luminance

MIXED = 2  # pixels around an edge over which a veil is mixed
EDGE = 1e-4  # squared contrast, encoded, that counts as one


def veil(optical_depth: NDArray, picture: Image, thickest: float = 1.0) -> NDArray[np.float32]:
    """Cover [H, W] by a veil: 1 - exp(-optical depth), at most `thickest`.

    A pixel on the edge of something near has a mixed colour but only one depth, so the veil is mixed as the colours
    are: by a guided filter (He, Sun and Tang 2010) of a pixel or two.

    Args:
        optical_depth: [H, W], along the ray of each pixel to what it shows.
        picture: what is veiled, [H, W, 3], sRGB-encoded.
        thickest: the most that the veil hides.
    """
    hidden = np.minimum(1 - np.exp(-optical_depth), thickest).astype(np.float32)
    grey = np.ascontiguousarray(luminance(picture), np.float32)
    return np.clip(cv2.ximgproc.guidedFilter(grey, hidden, MIXED, EDGE), 0, np.float32(thickest))
