"""Falling rain. Streaks are new in every view: no other view shows them, so a network finds them in each photograph.

    R = (1 - S - D) B + (S + D) beta,   in encoded values

A photograph I without its mist and its enhanced picture E have the cover alpha = (I - E) . (beta - E) / |beta - E|^2,
over the channels, away from predicted drops. D is alpha less its median in the view. S is the median cover of all rain,
and at least that median. In dense rain, the network finds too little of S: it removes single streaks, and leaves most
of the even layer that streaks add up to. In sparse rain most pixels are dry, so that S is far below the mean m of alpha
over all views. Pixels behind two streaks grow with m^2. The network finds fewer streaks the more of the lens drops
cover: their share is w. The model is S = EVEN m^2 / sqrt(1 - w), at most MOST_OVER_MEAN m. Rain falls if the network
finds rain of any kind, and m is at least LEAST_MEAN.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training.images import Size, TrainingImages
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized
from deraings.rain_model.kernels import behind_rain, shade
from hydroviews.scene.images import Image, to_uint8

# Light, medium and heavy rain of two generators on development scenes has an S of 0 to 0.17. The root mean square error
# is 0.02.
EVEN = 10.0
MOST_OVER_MEAN = 2.0  # S over m, 1.6 at most in that rain
# m from which rain falls. On development scenes, light streaks have an m of 0.018 to 0.058, and medium ones 0.046 and
# more, even behind drops. Dry views and medium drops have 0.005 at most. Heavy windows have 0.016: to model rain there
# costs 0.1 dB, and to leave rain out costs several times as much.
LEAST_MEAN = 0.01
MOST = 0.95  # rain_alpha
DROP = 0.1  # cover by drops from which a pixel shows no rain
BESIDE = np.ones((5, 5), np.uint8)  # of a pixel of the cover; drops change what is beside them
MIN_CONTRAST = 0.1  # encoded; in front of what is nearer to beta than that, streaks are hardly seen


class Rainfall:
    """S, and S + D of each view.

    Attributes:
        falls: whether the network finds falling rain.
        even_alpha: S.
    """

    def __init__(self, images: TrainingImages, network: EnhancedViews, brightness: float) -> None:
        """Rain that a network finds in photographs; shows progress.

        Args:
            images: the photographs.
            network: these photographs without their rain; it predicts covers.
            brightness: beta, the encoded value of streaks, (0, 1].

        Raises:
            InputError: a kept enhanced picture is damaged.
        """
        self.brightness = brightness
        self._images, self._network, self._dry = images, network, network.training_images()
        self._alphas: dict[int, NDArray[np.uint8]] = {}  # S + D [H, W], 255 for all, of views that were asked for
        mean, shown = self._mean() if network.finds_rain else (0.0, 1.0)
        self.falls = mean >= LEAST_MEAN
        self.even_alpha = mean * min(EVEN * mean / max(shown**0.5, 1e-6), MOST_OVER_MEAN)

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

    def _mean(self) -> tuple[float, float]:
        """m, or 0 if it is less, and 1 - w. The weight of a pixel is the square of its contrast to rain."""
        sums, counts = np.zeros(2), np.zeros(2)
        for view in tqdm(range(len(self._images)), desc="falling rain", unit="view", leave=False):
            product, square, shown = self._toward_rain(view)
            hidden = self._images.ignored(view)
            sums += product.sum(), square.sum()
            counts += shown.sum(), shown.size if hidden is None else (~hidden).sum()
        mean, share = sums[0] / sums[1] if sums[1] else 0.0, counts[0] / counts[1] if counts[1] else 0.0
        return max(float(mean), 0.0), float(share)

    def _alpha(self, view: int) -> Plane:
        product, square, shown = self._toward_rain(view)
        found = product / (square + np.float32(MIN_CONTRAST**2))
        median = np.float32(np.median(found[shown])) if shown.any() else np.float32(0)
        even = np.maximum(np.float32(self.even_alpha), median)  # never less than what the network removes
        return np.clip(np.where(shown, found - median + even, even), 0, MOST)

    def _toward_rain(self, view: int) -> tuple[Plane, Plane, NDArray[np.bool_]]:
        """(I - E) . (beta - E), |beta - E|^2, both 0 where a mask or drops hide the scene, and where not."""
        photograph, dry = self._network.without_mist(view), self._dry.pixels(view) / np.float32(255)
        cover = np.maximum(self._network.small_drop_cover(view), self._network.mean_drop_cover(view))
        shown = resized(np.asarray(cv2.dilate(cover, BESIDE), np.float32), dry.shape[:2]) < DROP
        hidden = self._images.ignored(view)
        shown = shown if hidden is None else shown & ~hidden
        contrast = np.maximum(np.float32(self.brightness) - dry, 0) * shown[..., None]
        return ((photograph - dry) * contrast).sum(axis=2), np.square(contrast).sum(axis=2), shown
