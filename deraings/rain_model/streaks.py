"""Single streaks, view by view: what even rain leaves of a photograph's difference, filtered along the rain.

Streaks overlap: in dense rain a view is no few bright lines upon nothing, but its rain_alpha varies about the median S,
to either side, in every pixel. A view's rain_alpha is therefore S and a deviation D of either sign,

    R = (1 - S - D) B + (S + D) beta,   in encoded values,

and where the scene is known well the difference of photograph and render is (beta - B) D and the scene's fine detail
that is not learned yet. Rain is long along one direction, so that its power lies in a wedge of frequencies across it;
what a scene leaves is much alike in all directions. What the wedge holds beyond the usual of the other directions is
rain, and D is that part of the difference: a Wiener filter, whose power spectra are means over the views. If a network
predicts streaks from each photograph, D begins with them, and the filter looks for what they leave.

A training of a few thousand iterations learns streaks one by one, each from its view. So D is taken soon after it is
sure that it rains, as the mean over a few visits of a view, and kept; and taken anew, twice, when the scene is known
better and has forgotten the streaks that D has explained.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from deraings.image_planes import Plane, resized, shrunk
from deraings.rain_model.kernels import toward_rain
from hydroviews.scene.images import Image

ZERO, STEP = 128, 1 / 200  # the 8 bits of D: what stands for 0, and for a difference of one
WEDGE = 35.0  # degrees to either side of the direction across the rain; 35 explains as much as 45
SMOOTH = 9  # frequencies, odd, each way, over which the power is averaged
RINGS = 64  # of frequencies, to one cycle a pixel
LONG_SIDE = 480  # pixels; streaks are looked for in no larger pictures
MIN_CONTRAST = 0.1  # encoded; in front of what is nearer to beta than that, streaks are hardly seen
VIEW = "view"  # begins the names of what is known of a view


class SingleStreaks:
    """Mean power of the differences by frequency, and each view's D."""

    def __init__(self, sizes: Sequence[tuple[int, int]], visits: int) -> None:
        """Nothing known yet of the views, whose sizes are (height, width); `visits` as in `RainfallConfig`."""
        self._visits = visits
        factor = max(1.0, max(max(size) for size in sizes) / LONG_SIDE)  # one for all: they share a spectrum
        small = [shrunk(size, factor) for size in sizes]
        self._small = small
        self._canvas = tuple(fft.next_fast_len(max(side), real=True) for side in zip(*small, strict=True))
        self.power = np.zeros((self._canvas[0], self._canvas[1] // 2 + 1))  # sums of squared amplitudes
        self.gain = np.zeros(self.power.shape, np.float32)  # of each frequency, once all views have been seen
        self.spectra = np.zeros(1, np.int64)  # views in `power`
        self.visits = np.zeros(len(sizes), np.int64)
        self.deviations: dict[int, NDArray[np.uint8]] = {}  # D [h, w] of the views seen so far

    def due(self, view: int) -> bool:
        """Whether a view is to be looked at if it surely rains."""
        return bool(self.visits[view] < self._visits)

    def renew(self) -> None:
        """Take everything anew: the scene is known better now. Until then D stays what it is."""
        self.power[:], self.spectra[:], self.visits[:] = 0, 0, 0

    def update(self, difference: Plane, contrast: Plane, angle: float, view: int, prior: Plane | None = None) -> None:
        """Take a view's streaks from it; first, until there is one of every view, its power.

        Args:
            difference: of photograph and render [H, W], and
            contrast: of rain and scene [H, W], both as of `along_rain`; where nothing is to be found both are 0.
            angle: of the streaks, degrees counter-clockwise from +x.
            view: index of the view.
            prior: D [H, W] by other means; what it leaves of the difference is filtered.
        """
        size = self._small[view]
        difference, contrast = resized(difference, size), resized(contrast, size)
        known = np.zeros(size, np.float32) if prior is None else resized(prior, size)
        spectrum = fft.rfft2(difference - contrast * known, self._canvas)
        spectrum[0, 0] = 0  # the mean belongs to S
        if self.spectra < len(self.visits):
            self._add_power(spectrum, angle)
            return
        streaks = fft.irfft2(spectrum * self.gain, self._canvas)[: size[0], : size[1]]
        self._add_deviation(view, known + alpha_along(streaks, contrast))

    def _add_power(self, spectrum: NDArray[np.complexfloating], angle: float) -> None:
        """One more view's power; after the last one the gain follows."""
        self.spectra += 1
        self.power += spectrum.real**2 + spectrum.imag**2
        if self.spectra == len(self.visits):
            self.gain = wiener_gain(self.power, self._canvas[1], angle)

    def _add_deviation(self, view: int, found: Plane) -> None:
        """D as found in one more visit of a view, to the mean of all."""
        n = self.visits[view]
        mean = (n * self._deviation(view) + found) / (n + 1)
        self.deviations[view] = np.clip(np.rint(mean / STEP) + ZERO, 0, 255).astype(np.uint8)
        self.visits[view] = n + 1

    def deviation(self, view: int) -> Plane | None:
        """D [h, w] of a view, at no more than LONG_SIDE pixels; None where nothing is known."""
        return self._deviation(view) if view in self.deviations else None

    def _deviation(self, view: int) -> Plane:
        if view not in self.deviations:
            return np.zeros(self._small[view], np.float32)
        return (self.deviations[view].astype(np.float32) - np.float32(ZERO)) * np.float32(STEP)

    def state_dict(self) -> dict[str, NDArray]:
        """Spectra and deviations, for checkpoints."""
        views = {f"{VIEW}{view}": deviation for view, deviation in self.deviations.items()}
        return {"power": self.power, "gain": self.gain, "spectra": self.spectra, "visits": self.visits, **views}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        self.power, self.gain = arrays["power"].copy(), arrays["gain"].copy()
        self.spectra, self.visits = arrays["spectra"].copy(), arrays["visits"].copy()
        views = [name for name in arrays if name.startswith(VIEW)]
        self.deviations = {int(name.removeprefix(VIEW)): arrays[name].copy() for name in views}


def along_rain(photograph: Image, seen: Image, even: float, brightness: float) -> tuple[Plane, Plane]:
    """How far a photograph is from what is seen behind even rain, towards rain, and how far that could be.

    A rain_alpha that is larger by D changes what is seen by D (beta - B), with B = (seen - S beta) / (1 - S).

    Args:
        photograph: [H, W, 3].
        seen: what is expected of it, [H, W, 3].
        even: S of it.
        brightness: beta, encoded.

    Returns:
        Photograph less `seen` along the unit vector of beta - B [H, W], encoded, and the length of beta - B [H, W].
    """
    along, length = np.empty((2, *photograph.shape[:2]), np.float32)
    toward_rain(photograph, seen, np.float32(brightness), np.float32(1 - even), along, length)
    return along, length


def alpha_along(along: Plane, length: Plane) -> Plane:
    """The rain_alpha [H, W] of what `along_rain` returns; near 0 where the contrast to rain is small."""
    return along * length / (np.square(length) + np.float32(MIN_CONTRAST**2))


def wiener_gain(power: NDArray, width: int, angle: float, side: int = SMOOTH) -> Plane:
    """Gain [H, W // 2 + 1] of each frequency: the share of its power that rain has.

    The power of the scene is taken to be the median of all frequencies as high outside of the wedge across the rain.

    Args:
        power: by frequency [H, W // 2 + 1], as of `scipy.fft.rfft2`.
        width: of the pictures, W.
        angle: of the rain, degrees counter-clockwise from +x.
        side: frequencies each way over which the power is averaged.
    """
    down, right = fft.fftfreq(power.shape[0])[:, None], fft.rfftfreq(width)[None]
    around = np.abs((np.degrees(np.arctan2(-down, right)) - angle) % 180 - 90)  # degrees from across the rain
    inside = around <= WEDGE
    smooth = _averaged(power, width, side)
    rings = (np.hypot(down, right) * RINGS).astype(int)
    known = [ring for ring in range(rings.max() + 1) if ((rings == ring) & ~inside).any()]
    usual = [np.median(smooth[(rings == ring) & ~inside]) for ring in known]
    scene = np.interp(np.arange(rings.max() + 1), known, usual)[rings]
    share = 1 - np.divide(scene, smooth, out=np.ones_like(smooth), where=smooth > 0)
    return np.asarray(np.maximum(share, 0) * inside, np.float32)


def _averaged(power: NDArray, width: int, side: int) -> NDArray:
    """Averages over side x side frequencies of a spectrum [H, W // 2 + 1], which is symmetric and periodic."""
    columns = np.arange(-(side // 2), power.shape[1] + side // 2)
    mirrored = np.roll(power[::-1], 1, axis=0)
    planes = [power[:, c] if c >= 0 else mirrored[:, -c] for c in columns if c < power.shape[1]]
    planes += [mirrored[:, width - c] for c in columns if c >= power.shape[1]]
    wide = np.pad(np.stack(planes, axis=1), ((side // 2, side // 2), (0, 0)), mode="wrap")
    blurred = cv2.blur(wide, (side, side))
    half = side // 2
    return np.asarray(blurred[half : half + power.shape[0], half : half + power.shape[1]])
