"""Single streaks, view by view: what the even cover by falling rain leaves of a photograph, filtered along the rain.

Streaks overlap: in dense rain the cover of a view is no few bright lines upon nothing, but varies about its median, to
either side, in every pixel. A view's S is therefore the even cover and a deviation D of either sign,

    R = (1 - S - D) B + (S + D) beta,   in encoded values,

and where the scene is known well the difference of photograph and render is (beta - B) D and the scene's fine detail
that is not learned yet. Rain is long along one direction, so that its power lies in a wedge of frequencies across it;
what a scene leaves is much alike in all directions. What the wedge holds beyond the usual of the other directions is
rain, and D is that part of the difference: a Wiener filter, whose power spectra are means over the views.

A training of a few thousand iterations learns streaks one by one, each from its view. So D is taken soon after it is
sure that it rains, as the mean over a few visits of a view, and kept; and taken anew, twice, when the scene is known
better, which has forgotten the streaks that D has explained.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from deraings.planes import Plane, resized, shrunk
from deraings.rain_model.rain_layer import LONG_SIDE
from hydroviews.scene.images import Image

EVEN, STEP = 128, 1 / 200  # the 8 bits of D: what stands for nought, and for a difference of one
RINGS = 64  # of frequencies, to one cycle a pixel
VIEW = "view"  # begins the names of what is known of a view
LEAST = 0.1  # encoded; in front of what is nearer to beta than that, streaks are hardly seen


@dataclass(frozen=True)
class StreakConfig:
    """How single streaks are found."""

    wedge: float = 35.0  # degrees to either side of the rain's direction
    smooth: int = 9  # frequencies, each way, over which the power is averaged
    visits: int = 3  # of each view, over which D is averaged; before, as many looks as views for the spectra
    renewed: tuple[float, ...] = (0.45, 0.65)  # shares of the iterations at which all that is taken anew
    most: float = 0.95  # cover


class Streaks:
    """Mean power of the differences by frequency, and each view's D."""

    def __init__(self, sizes: Sequence[tuple[int, int]], config: StreakConfig) -> None:
        """Nothing known yet of the views, whose sizes are (height, width)."""
        self._config = config
        factor = max(1.0, max(max(size) for size in sizes) / LONG_SIDE)  # one for all: they share a spectrum
        small = [shrunk(size, factor) for size in sizes]
        self._full, self._small = list(sizes), small
        self._canvas = tuple(fft.next_fast_len(max(side), real=True) for side in zip(*small, strict=True))
        self.power = np.zeros((self._canvas[0], self._canvas[1] // 2 + 1))  # sums of squared amplitudes
        self.gain = np.zeros(self.power.shape, np.float32)  # of each frequency, known after as many looks as views
        self.looks = np.zeros(1, np.int64)
        self.visits = np.zeros(len(sizes), np.int64)
        self.deviations: dict[int, NDArray[np.uint8]] = {}  # D [h, w] of the views seen so far

    def due(self, view: int, size: tuple[int, int]) -> bool:
        """Whether a view, rendered at (height, width), is to be looked at if it surely rains."""
        return self.visits[view] < self._config.visits and size == self._full[view]

    def renew(self) -> None:
        """Look at everything anew: the scene is known better now. Until then what was found is kept."""
        self.power[:], self.looks[:], self.visits[:] = 0, 0, 0

    def observe(
        self, difference: Plane, contrast: Plane, angle: float, view: int, witness: Plane | None = None
    ) -> None:
        """Look at a view for its streaks.

        Args:
            difference: of photograph and render [H, W], and
            contrast: of rain and scene [H, W], both as of `along_rain`; where nothing is to be found both are 0.
            angle: of the streaks, degrees counter-clockwise from +x.
            view: index of the view.
            witness: what somebody else takes D for [H, W], of whom as much is believed.
        """
        size = self._small[view]
        difference, contrast = resized(difference, size), resized(contrast, size)
        spectrum = fft.rfft2(difference, self._canvas)
        spectrum[0, 0] = 0  # the mean is the even cover's
        if self.looks < len(self.visits):
            self.looks += 1
            self.power += spectrum.real**2 + spectrum.imag**2
            if self.looks == len(self.visits):
                self.gain = wiener_gain(self.power, self._canvas[1], angle, self._config)
            return
        streaks = fft.irfft2(spectrum * self.gain, self._canvas)[: size[0], : size[1]]
        found = streaks * contrast / (contrast**2 + np.float32(LEAST**2))
        if witness is not None:
            found = (found + resized(witness, size)) / 2
        n = self.visits[view]
        mean = (n * self.deviation(view) + found) / (n + 1)
        self.deviations[view] = np.clip(np.rint(mean / STEP) + EVEN, 0, 255).astype(np.uint8)
        self.visits[view] = n + 1

    def deviation(self, view: int) -> Plane:
        """D [h, w] of a view, at no more than LONG_SIDE pixels; nought where nothing is known."""
        if view not in self.deviations:
            return np.zeros(self._small[view], np.float32)
        return (self.deviations[view].astype(np.float32) - np.float32(EVEN)) * np.float32(STEP)

    def cover(self, view: int, even: float, size: tuple[int, int]) -> Plane | None:
        """S + D [H, W] of a view; None where nothing is known but S."""
        if view not in self.deviations:
            return None
        return np.clip(np.float32(even) + resized(self.deviation(view), size), 0, np.float32(self._config.most))

    def state_dict(self) -> dict[str, NDArray]:
        """All that was observed, for checkpoints."""
        views = {f"{VIEW}{view}": deviation for view, deviation in self.deviations.items()}
        return {"power": self.power, "gain": self.gain, "looks": self.looks, "visits": self.visits, **views}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
        self.power, self.gain = arrays["power"].copy(), arrays["gain"].copy()
        self.looks, self.visits = arrays["looks"].copy(), arrays["visits"].copy()
        views = [name for name in arrays if name.startswith(VIEW)]
        self.deviations = {int(name.removeprefix(VIEW)): arrays[name].copy() for name in views}


def along_rain(photograph: Image, seen: Image, cover: float, brightness: float) -> tuple[Plane, Plane]:
    """How far a photograph is from what is seen behind an even cover, towards rain, and how far that could be.

    A cover that is larger by D changes what is seen by D (beta - B), with B = (seen - S beta) / (1 - S).

    Args:
        photograph: [H, W, 3].
        seen: what is expected of it, [H, W, 3].
        cover: S of it.
        brightness: beta, encoded.

    Returns:
        Photograph less `seen` along the unit vector of beta - B [H, W], encoded, and the length of beta - B [H, W].
    """
    contrast = np.maximum(np.float32(brightness) - seen, 0) / np.float32(1 - cover)
    length = np.sqrt(np.einsum("hwc,hwc->hw", contrast, contrast))
    along = np.einsum("hwc,hwc->hw", photograph - seen, contrast) / np.maximum(length, np.float32(1e-3))
    return along, length


def cover_between(photograph: Image, dry: Image, brightness: float) -> Plane:
    """The cover by rain [H, W] that makes a photograph [H, W, 3] of a dry picture of the same; little if S is unclear.

    Least squares over the channels of O - B = S (beta - B), of which what is near to beta says little.
    """
    contrast = np.maximum(np.float32(brightness) - dry, 0)
    along = np.einsum("hwc,hwc->hw", photograph - dry, contrast)
    return np.asarray(along / (np.einsum("hwc,hwc->hw", contrast, contrast) + np.float32(LEAST**2)), np.float32)


def wiener_gain(power: NDArray, width: int, angle: float, config: StreakConfig) -> Plane:
    """Gain [H, W // 2 + 1] of each frequency: the share of its power that is rain's.

    The power of the scene is taken to be the median of all frequencies as high outside of the wedge across the rain.

    Args:
        power: by frequency [H, W // 2 + 1], as of `scipy.fft.rfft2`.
        width: of the pictures, W.
        angle: of the rain, degrees counter-clockwise from +x.
        config: the wedge, and how the power is averaged.
    """
    down, right = fft.fftfreq(power.shape[0])[:, None], fft.rfftfreq(width)[None]
    around = np.abs((np.degrees(np.arctan2(-down, right)) - angle) % 180 - 90)  # degrees from across the rain
    inside = around <= config.wedge
    smooth = _averaged(power, width, config.smooth)
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
