"""Falling rain. Streaks are new in every view: no other view shows them, so a network finds them in each photograph.

    R = (1 - S - D) B + (S + D) beta,   in encoded values

A photograph I and its enhanced picture E have the cover alpha = (I - E) . (beta - E) / |beta - E|^2, over the channels.
D is alpha less its median in the view. S is the median cover of all rain. In dense rain, the network finds too little
of S: it removes single streaks, and leaves most of the even layer that streaks add up to. The mean m and the standard
deviation s of alpha over all views show how dense rain is. Sparse rain leaves most pixels dry, so that the median is
far below the mean, and s is large. In dense rain streaks overlap: the median is about the mean, and s is small. The
model is S / m = EVEN m^1.5 / s, at most MOST_OVER_MEAN.
"""

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training.images import Size, TrainingImages
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized
from deraings.rain_model.kernels import behind_rain, shade
from hydroviews.scene.images import Image, to_uint8

# Light, medium and heavy rain of two generators on development scenes has an S of 0 to 0.17. The error is 0.02 at most.
EVEN = 2.6
MOST_OVER_MEAN = 2.0  # S over m, 1.5 at most in that rain
MOST = 0.95  # rain_alpha
MIN_CONTRAST = 0.1  # encoded; in front of what is nearer to beta than that, streaks are hardly seen


class Rainfall:
    """S, and S + D of each view."""

    def __init__(self, images: TrainingImages, network: EnhancedViews, brightness: float) -> None:
        """Rain that a network finds in photographs; shows progress.

        Args:
            images: the photographs.
            network: these photographs without their rain.
            brightness: beta, the encoded value of streaks, (0, 1].

        Raises:
            InputError: a kept enhanced picture is damaged.
        """
        self.brightness = brightness
        self._images, self._dry = images, network.training_images()
        self._alphas: dict[int, NDArray[np.uint8]] = {}  # S + D [H, W], 255 for all, of views that were asked for
        self.even_alpha = self._even_alpha()  # S

    def alpha(self, view: int, size: Size) -> Plane:
        """rain_alpha S + D [H, W] of a view at (height, width), in [0, MOST]."""
        if view not in self._alphas:
            self._alphas[view] = to_uint8(self._alpha(view))
        return resized(self._alphas[view].astype(np.float32) / np.float32(255), size)

    def forward(self, image: Image, alpha: Plane, out: Image) -> Image:
        """The view [H, W, 3] behind rain of alpha [H, W], written to `out`."""
        behind_rain(image, alpha, np.float32(self.brightness), out)
        return out

    def backward(self, gradient: Image, alpha: Plane, out: Image) -> Image:
        """The gradient by the view [H, W, 3], written to `out`, from that by what `forward` returned."""
        shade(gradient, alpha, out)
        return out

    def _even_alpha(self) -> float:
        """S of all views. The weight of a pixel is the square of its contrast to rain."""
        sums = np.zeros(3)
        for view in tqdm(range(len(self._images)), desc="falling rain", unit="view", leave=False):
            product, square = self._toward_rain(view)
            sums += product.sum(), square.sum(), (product**2 / np.maximum(square, MIN_CONTRAST**2)).sum()
        if sums[0] <= 0:
            return 0.0
        mean, mean_square = sums[[0, 2]] / sums[1]
        deviation = np.sqrt(max(mean_square - mean**2, 0))
        return float(mean * min(EVEN * mean**1.5 / max(deviation, 1e-6), MOST_OVER_MEAN))

    def _alpha(self, view: int) -> Plane:
        product, square = self._toward_rain(view)
        found = product / (square + np.float32(MIN_CONTRAST**2))
        hidden = self._images.ignored(view)
        shown = np.ones(found.shape, np.bool_) if hidden is None else ~hidden
        deviation = np.where(shown, found - np.median(found[shown]), 0) if shown.any() else np.zeros_like(found)
        return np.clip(np.float32(self.even_alpha) + deviation, 0, MOST)

    def _toward_rain(self, view: int) -> NDArray[np.float32]:
        """(I - E) . (beta - E) and |beta - E|^2 of a view [2, H, W]; 0 where a mask hides the photograph."""
        photograph, dry = (images.pixels(view) / np.float32(255) for images in (self._images, self._dry))
        contrast = np.maximum(np.float32(self.brightness) - dry, 0)
        planes = np.stack([((photograph - dry) * contrast).sum(axis=2), np.square(contrast).sum(axis=2)])
        hidden = self._images.ignored(view)
        return planes if hidden is None else planes * ~hidden
