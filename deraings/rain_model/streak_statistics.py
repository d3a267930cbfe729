"""Whether differences of photographs and renders look like falling rain, and how much rain that is.

* *That it rains.* Averaged along short lines at twelve angles, less their surroundings, the differences of a dry scene
  are skewed much alike at all angles, if at all; in rain they are skewed to the bright side along the streaks.
* *How much.* Streaks that fall independently of each other are shot noise, all of whose cumulants are in proportion to
  their number (Campbell's theorem): variance and third cumulant say how strong single streaks are, and with that the
  variance says how many there are, and so how much rain there is in the mean. Both are taken along the streaks, less
  the usual of the other directions, which is the scene's.
"""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane
from deraings.rain_model.kernels import BANDS, line_sums

ANGLES = tuple(range(0, 180, 15))  # degrees counter-clockwise from +x
OUTLIER = 4.0  # standard deviations beyond which a difference along a line is cut off
# kappa_1 kappa_3 / kappa_2^2 of streaks that are even along and soft across, 2 / sqrt(3), and a little uneven.
SHOT_RATIO = 1.2
COMMON = 0.15  # share of the skew of most directions that one may exceed them by: drops that ran are long as well
LEAST = 1e-12  # that is divided by


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


def _line_means(along: Plane, around: Plane, counted: NDArray[np.bool_], n: int, limit: float) -> NDArray:
    """Means [3] of x, x^2 and x^3, x = along - around [H, W] cut off at +-limit, over the n pixels that are counted."""
    sums = np.empty((BANDS, 3))
    line_sums(along, around, counted, np.float32(limit), sums)
    return np.asarray(sums.sum(axis=0) / n)


def along_line(plane: Plane, clear: NDArray[np.bool_], length: float, angle: float) -> NDArray[np.float32]:
    """A plane [H, W] averaged along lines at an angle, less its surroundings, where it is `clear` [n]."""
    side, plane = line_side(plane.shape, length), _filled(plane, clear)
    along = cv2.filter2D(plane, -1, line_kernel(side, angle))
    return np.asarray(along - cv2.blur(plane, (side, side)), np.float32)[clear]


def _filled(plane: Plane, clear: NDArray[np.bool_]) -> Plane:
    """A plane [H, W] with the mean of what is `clear` elsewhere: edges of what is hidden are no lines."""
    return np.where(clear, plane, plane[clear].mean())


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


def streak_angle(powers: NDArray) -> int:
    """The direction of the streaks in degrees counter-clockwise from +x, to 15 degrees, from sums of `line_powers`."""
    return ANGLES[int(np.argmax(_skews(powers)))]


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


def _skews(powers: NDArray) -> NDArray:
    count, squares, cubes = powers.T
    scale = squares**1.5 / np.sqrt(np.maximum(count, LEAST))
    return np.divide(cubes, scale, out=np.zeros(len(powers)), where=scale > 0)
