"""Changes by a camera after the rain: sensor noise and JPEG."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import Image


def compressed(picture: Image, quality: int) -> Image:
    """A picture [H, W, 3] after JPEG of a quality from 1 to 100."""
    pixels = np.rint(255 * picture[..., ::-1]).astype(np.uint8)
    _, stored = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    read = cast(NDArray[np.uint8], cv2.imdecode(stored, cv2.IMREAD_COLOR))
    return np.ascontiguousarray(read[..., ::-1], np.float32) / 255


def noisy(picture: Image, sigma: float, rng: np.random.Generator) -> Image:
    """A picture [H, W, 3] with Gaussian noise of a standard deviation in encoded values, clipped to [0, 1]."""
    noise = np.float32(sigma) * rng.standard_normal(picture.shape, np.float32)
    return np.asarray(np.clip(picture + noise, 0, 1), np.float32)
