"""Falling rain: new in every view, so that views disagree on it, but it only ever adds light.

What many views agree on is the median, and in denser rain there is some of it in front of the median pixel: the scene
is learned as if behind an even layer, R = (1 - S) B + S beta in encoded values with S the median rain_alpha. Such a
layer cannot be told from a brighter scene of less contrast by any single pixel. Two things tell it:

* *That it rains.* Rain is what makes the differences of photograph and render skewed to the bright side along one
  direction only: averaged along short lines at twelve angles, less their surroundings, the differences of a dry scene
  are skewed much alike at all angles, if at all; in rain they are more so along the streaks.
* *How much.* Streaks that fall independently of each other are shot noise, all of whose cumulants are in proportion to
  their number (Campbell's theorem): variance and third cumulant say how strong single streaks are, and with that the
  variance says how many there are, and so how much rain there is in the mean. Both are taken of the rain_alpha that
  makes the photograph of the render, along the streaks, less the usual of the other directions, which is the scene's.
  Where a prior sees the rain of single photographs, S is a mean of both opinions.

The first gates the second: where it does not rain S is 0, whatever the scene.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, resized, within_side
from deraings.rain_model.layer_kernels import behind_rain, shade
from deraings.rain_model.rain_kernels import BANDS, cover, line_sums
from hydroviews.scene.images import Image

ANGLES = tuple(range(0, 180, 15))  # degrees counter-clockwise from +x
THIRDS = np.full(3, 1 / 3, np.float32)
LONG_SIDE = 480  # pixels; streaks are looked for in no larger pictures
LEARNED = ("powers", "shot_alpha", "prior", "prior_along", "alpha")
OUTLIER = 4.0  # standard deviations beyond which a difference along a line is cut off
MIN_CONTRAST = 0.1  # encoded; in front of what is nearer to beta than that, streaks are hardly seen
TELLING = 0.2  # the same; what is nearer is not counted
HALF = 0.5
MIN_CLEAR = 0.05  # share of a view's pixels that tell; the skewness of fewer is chance
LEAST = 1e-12  # that is divided by
# kappa_1 kappa_3 / kappa_2^2 of streaks that are even along and soft across, 2 / sqrt(3), and a little uneven.
SHOT_RATIO = 1.2
MIN_ALPHA = 0.004  # rain_alpha that is as good as none
COMMON = 0.15  # share of the skew of most directions that one may exceed them by: drops that ran are long as well


@dataclass(frozen=True)
class RainLayerConfig:
    """How falling rain is found and accounted for.

    Numbers without a source were chosen on courtyard and LLFF flower (docs/experiments/2026-11-rain-model.md).

    Attributes:
        brightness: beta, the encoded value of streaks, (0, 1]. It cannot be told from the photographs; an error of 0.1
            changes the scene by 0.1 S.
        line_length: length of the lines along which differences are averaged, in longer sides of the picture, (0, 1).
        start: share of the iterations, [0, 1), before the first update; earlier, detail that is not learned yet would
            be taken for streaks. 0.1 is best of 0.05 to 0.2.
        settled: share of the iterations after which the streaks' cumulants are not looked at any more if it surely
            rains: renders have learned some of the streaks by then.
        updates: in all, spread evenly over the training.
        memory: updates that running sums remember, more than `min_updates`.
        min_updates: sum of remembered weights before anything is believed, some 16 updates: after fewer, dry scenes
            were taken for rainy for a moment.
        dry: excess skew of one direction up to which it does not rain.
        rainy: excess skew, above `dry`, from which it surely does.
        max_alpha: most that S may be, [0, 1).
    """

    brightness: float = 0.88
    line_length: float = 1 / 45
    start: float = 0.1
    settled: float = 0.5
    updates: int = 240
    memory: int = 60
    min_updates: float = 14.0
    dry: float = 0.06
    rainy: float = 0.12
    max_alpha: float = 0.5

    def __post_init__(self) -> None:
        if not self.min_updates < self.memory:
            raise ValueError(
                f"min_updates {self.min_updates} of {self.memory} remembered ones: rain could never be believed"
            )
        if not self.dry < self.rainy:
            raise ValueError(f"rainy {self.rainy} is no more than dry {self.dry}")


class RainLayer:
    """Running statistics of photographs and renders, and the median rain_alpha S that follows."""

    def __init__(self, iterations: int, config: RainLayerConfig) -> None:
        self._config = config
        self._first, self._settled = round(config.start * iterations), round(config.settled * iterations)
        self._every = max(1, (iterations - self._first) // config.updates)
        self.powers = np.zeros((len(ANGLES), 3))  # sums of weights, squares and cubes of differences along lines
        self.shot_alpha = np.zeros(1)  # S as the streaks' cumulants have it
        self.prior = np.zeros(2)  # sum and number of the prior's median alphas
        self.prior_along = np.zeros(2)  # sums of (prior x scene) and prior^2, both along the streaks
        self.alpha = np.zeros(1)  # S

    @property
    def brightness(self) -> float:
        """beta, the encoded value of what streaks are made of."""
        return self._config.brightness

    def forward(self, image: Image, alpha: Plane, out: Image) -> Image:
        """The view [H, W, 3] behind rain of alpha [H, W], written to `out`."""
        behind_rain(image, alpha, np.float32(self.brightness), out)
        return out

    def backward(self, gradient: Image, alpha: Plane, out: Image) -> Image:
        """The gradient by the view [H, W, 3], written to `out`, from that by what `forward` returned."""
        shade(gradient, alpha, out)
        return out

    def due(self, iteration: int) -> bool:
        """Whether to look at a view in this step."""
        return iteration >= self._first and iteration % self._every == 0

    def update(self, photograph: Image, seen: Image, weights: NDArray[np.float32] | None, iteration: int) -> None:
        """Add a view to the statistics, and renew S; a view that is too light nearly everywhere tells nothing.

        Args:
            photograph: [H, W, 3].
            seen: what the model expects of it, [H, W, 3], behind even rain.
            weights: of the pixels [H, W]; those of weight 0 are not looked at.
            iteration: of the training.
        """
        config = self._config
        alpha = np.clip(alpha_between(photograph, seen, self.brightness), -1, 1)
        clear = self._tells(seen, weights)
        if clear.mean() < MIN_CLEAR:
            return
        powers = line_powers(_small(alpha), config.line_length, _small_mask(clear))
        self.powers = (1 - 1 / config.memory) * self.powers + powers
        if iteration < self._settled or self.certainty() < 1:
            self.shot_alpha[0] = alpha_of_shot_noise(self.powers)
        self.alpha[0] = min(self.certainty() * self.alpha_if_it_rains(), config.max_alpha)

    def update_prior(self, photograph: Image, without_rain: Image, seen: Image, shown: Plane | None) -> Plane:
        """Add what a prior finds in a view, and how that compares with what the scene says.

        Args:
            photograph: [H, W, 3].
            without_rain: the same as the prior has it, [H, W, 3].
            seen: what the model expects of it, [H, W, 3], behind even rain.
            shown: [H, W], 0 where the photograph is hidden, 1 elsewhere, not 0 everywhere; None where all is shown.

        Returns:
            D as the prior finds it [H, W], 0 where the photograph is hidden; the median of the rest is 0.
        """
        found, by_scene = (alpha_between(photograph, dry, self.brightness) for dry in (without_rain, seen))
        median = np.median(found if shown is None else found[shown > 0])
        self.prior += float(median), 1
        clear = _small_mask(self._tells(seen, shown))
        if clear.mean() >= MIN_CLEAR:
            by_scene = (1 - self.alpha[0]) * np.clip(by_scene, -1, 1)
            prior, scene = (self._along_streaks(_small(plane), clear) for plane in (found, by_scene))
            self.prior_along += np.mean(prior * scene), np.mean(prior**2)
        return found - median if shown is None else (found - median) * shown

    def prior_gain(self) -> float:
        """How many times the streaks that the prior finds the scene has: the slope of one in the other; 1 if unknown.

        A network that sees a single picture draws streaks paler and wider than they are. By how much, the other views
        tell: what else a render lacks is independent of it.
        """
        products, squares = self.prior_along
        return max(0.0, float(products / squares)) if squares > LEAST else 1.0

    def alpha_if_it_rains(self) -> float:
        """S if it surely rained: what the streaks' cumulants say, or a mean of that and what the prior finds.

        The prior's median is too little of dense rain, and times `prior_gain` too much of sparse rain. Opinions differ
        by factors, and too large an S costs more than too small a one: the means are geometric. A prior that sees next
        to no rain takes away half of S at most.
        """
        shot = float(self.shot_alpha[0])
        if not self.prior[1]:
            return shot
        found = max(0.0, self.prior[0] / self.prior[1]) * np.sqrt(self.prior_gain())
        return max(0.5 * shot, float(np.sqrt(shot * found)))

    def certainty(self) -> float:
        """How sure it is that it rains, 0 to 1; 0 after few updates."""
        config = self._config
        if self.powers[0, 0] < config.min_updates:
            return 0.0
        return float(np.clip((directed_skew(self.powers) - config.dry) / (config.rainy - config.dry), 0, 1))

    def angle(self) -> int:
        """The direction of the streaks in degrees counter-clockwise from +x, to 15 degrees."""
        return ANGLES[int(np.argmax(_skews(self.powers)))]

    def _tells(self, seen: Image, weights: Plane | None) -> NDArray[np.bool_]:
        """Where a view [H, W, 3] is dark enough, and weighs enough, to show rain in front of it [H, W]."""
        clear = self.brightness - seen @ THIRDS > TELLING
        return clear if weights is None else clear & (weights > HALF)

    def _along_streaks(self, alpha: Plane, clear: NDArray[np.bool_]) -> NDArray[np.float32]:
        """A plane [H, W] averaged along the streaks, less its surroundings, where it is `clear` [n]."""
        side = line_side(alpha.shape, self._config.line_length)
        filled = _filled(alpha, clear)
        along = cv2.filter2D(filled, -1, line_kernel(side, self.angle()))
        return np.asarray(along - cv2.blur(filled, (side, side)), np.float32)[clear]

    def state_dict(self) -> dict[str, NDArray]:
        """All statistics, for checkpoints."""
        return {name: getattr(self, name) for name in LEARNED}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for name in LEARNED:
            setattr(self, name, arrays[name].copy())


def alpha_between(photograph: Image, dry: Image, brightness: float) -> Plane:
    """The rain_alpha [H, W] that turns a dry picture [H, W, 3] into its photograph; near 0 where they do not tell.

    Least squares over the channels of O - B = rain_alpha (beta - B), which tells little where B is near to beta.
    """
    alpha = np.empty(photograph.shape[:2], np.float32)
    cover(photograph, dry, np.float32(brightness), np.float32(MIN_CONTRAST**2), alpha)
    return alpha


def line_powers(difference: NDArray[np.float32], length: float, clear: NDArray[np.bool_] | None) -> NDArray:
    """1 and the means of squares and cubes [A, 3] of a picture averaged along lines at `ANGLES`, less its surroundings.

    Args:
        difference: [H, W].
        length: of the lines, in longer sides of the picture.
        clear: pixels that count [H, W]; all by default.
    """
    side = line_side(difference.shape, length)
    if clear is not None:
        if not clear.any():
            return np.zeros((len(ANGLES), 3))
        difference = _filled(difference, clear)
    counted = np.ones(difference.shape, np.bool_) if clear is None else clear
    around, n = np.asarray(cv2.blur(difference, (side, side)), np.float32), np.count_nonzero(counted)
    powers = np.ones((len(ANGLES), 3))
    for row, angle in zip(powers, ANGLES, strict=True):
        along = np.asarray(cv2.filter2D(difference, -1, line_kernel(side, angle)), np.float32)
        mean, square, _ = _line_means(along, around, counted, n, np.inf)
        row[1:] = _line_means(along, around, counted, n, OUTLIER * np.sqrt(max(square - mean**2, 0)))[1:]
    return powers


def _filled(plane: Plane, clear: NDArray[np.bool_]) -> Plane:
    """A plane [H, W] with the mean of what is `clear` elsewhere: edges of what is hidden are no lines."""
    return np.where(clear, plane, plane[clear].mean())


def _line_means(along: Plane, around: Plane, counted: NDArray[np.bool_], n: int, limit: float) -> NDArray:
    """Means [3] of x, x^2 and x^3, x = along - around [H, W] cut off at +-limit, over the n pixels that are counted."""
    sums = np.empty((BANDS, 3))
    line_sums(along, around, counted, np.float32(limit), sums)
    return np.asarray(sums.sum(axis=0) / n)


def line_side(size: tuple[int, ...], length: float) -> int:
    """The side of `line_kernel` in pixels, odd, for lines of `length`, in longer sides, in pictures of (H, W)."""
    return max(3, round(max(size) * length)) | 1


@cache
def line_kernel(side: int, angle: float) -> NDArray[np.float32]:
    """A line through the middle of [side, side] at `angle` degrees counter-clockwise from +x, of sum 1."""
    reach = np.linspace(-(side - 1) / 2, (side - 1) / 2, 8 * side)
    x = reach * np.cos(np.radians(angle)) + (side - 1) / 2
    y = -reach * np.sin(np.radians(angle)) + (side - 1) / 2
    knots = np.arange(side)
    columns, rows = (np.maximum(0, 1 - np.abs(place[:, None] - knots)) for place in (x, y))
    return np.asarray(rows.T @ columns / len(reach), np.float32)


def alpha_of_shot_noise(powers: NDArray) -> float:
    """The mean rain_alpha of shot noise that has the excess variance and third cumulant of one direction, [0, 1).

    With single streaks of profile s, so many that they add up to the mean kappa_1, kappa_n is in proportion to the
    integral of s^n (Campbell), and kappa_1 = c kappa_2^2 / kappa_3, whatever their number and strength. In front of a
    scene that is seen behind even rain, differences are of (rain_alpha - S) / (1 - S), so this is the mean of
    rain_alpha / (1 - S).

    Args:
        powers: sums of weights, squares and cubes [A, 3], as of `line_powers`.
    """
    squares, cubes = powers[:, 1:].T / max(powers[0, 0], LEAST)
    along = int(np.argmax(_skews(powers)))
    variance, third = squares[along] - np.median(squares), cubes[along] - np.median(cubes)
    if variance <= 0 or third <= 0:
        return 0.0
    mean = SHOT_RATIO * variance**2 / third
    return float(mean / (1 + mean))


def directed_skew(powers: NDArray) -> float:
    """By how much the skewness along one direction exceeds what that along most others allows; 0 before any update.

    Rain is lighter than the scene: where all directions are skewed to the dark side, it is 0. Where drops on the lens
    make all directions skewed, one stands out a little more. Falling rain stands out alone.
    """
    skews = _skews(powers)
    if skews.max() <= 0:
        return 0.0
    usual = float(np.median(skews))
    return float(skews.max()) - usual - COMMON * max(0.0, usual)


def _skews(powers: NDArray) -> NDArray:
    count, squares, cubes = powers.T
    scale = squares**1.5 / np.sqrt(np.maximum(count, LEAST))
    return np.divide(cubes, scale, out=np.zeros(len(powers)), where=scale > 0)


def _small(plane: Plane) -> Plane:
    """A plane [H, W], averaged down to a longer side of LONG_SIDE."""
    return resized(plane, within_side(plane.shape, LONG_SIDE))


def _small_mask(clear: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The same of a mask: where more than half of a pixel is clear."""
    return _small(clear.astype(np.float32)) > HALF
