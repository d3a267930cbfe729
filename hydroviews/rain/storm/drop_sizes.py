"""What a storm is made of: how many drops of each size, how fast they fall, and what they hide of the distance.

Sizes follow Marshall and Palmer (1948): N(D) = N0 exp(-Lambda D) drops a cubic metre and millimetre of diameter, with
N0 = 8000 and Lambda = 4.1 R^-0.21 for a rain of R millimetres an hour. They fall at v(D) = 9.65 - 10.3 exp(-0.6 D)
metres a second (Atlas, Srivastava and Sekhon 1973, a fit to the measurements of Gunn and Kinzer 1949).

A camera sees single drops only nearby, and larger ones from farther. So a drop of diameter D is drawn up to the
distance `reach * D`, and all that lies beyond is a veil with the cross-section of those drops: nothing is counted
twice and nothing is left out.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from hydroviews.scene.seeds import generator

INTERCEPT = 8000.0  # N0, drops a cubic metre and millimetre of diameter
SMALLEST, LARGEST = 0.5, 6.0  # diameters in mm that are drawn; smaller ones are veil, larger ones break up
BUDGET = 100_000  # drops in a storm of density 1; about one in thirty is in a picture
FARTHEST_REACH = 4.0  # metres a millimetre of diameter: farther off a streak is below what 8 bits can show
DEEPEST = 100.0  # metres of rain in front of the sky


@dataclass(frozen=True, eq=False)
class Cloud:
    """Drops in a world that repeats itself, each with a period that grows with the drop.

    A camera sees the copy of each drop that is nearest to it, so a drop's place is the same for all cameras, wherever
    they are, and the number of drops around each camera stays constant.
    """

    positions: NDArray[np.float64]  # [N, 3] metres, at time 0
    velocities: NDArray[np.float64]  # [N, 3] metres a second
    diameters: NDArray[np.float64]  # [N] metres
    periods: NDArray[np.float64]  # [N] metres; a drop is seen up to half of it

    def __len__(self) -> int:
        return len(self.diameters)


def slope(rate: float) -> float:
    """Lambda, 1/mm, for a rain of `rate` mm/h."""
    return 4.1 * float(rate) ** -0.21


def fall_speed(diameters: NDArray) -> NDArray:
    """Terminal velocity in m/s of drops of these diameters in mm."""
    return 9.65 - 10.3 * np.exp(-0.6 * np.asarray(diameters))


def moment(order: int, rate: float, low: float, high: float) -> float:
    """Integral of D^order N(D) from `low` to `high` mm: mm^order a cubic metre."""
    rise = slope(rate)
    gamma = float(np.prod(np.arange(1, order + 1)))
    whole = INTERCEPT * gamma / rise ** (order + 1)
    return whole * float(gammainc(order + 1, rise * high) - gammainc(order + 1, rise * low))


def reach(rate: float) -> float:
    """Metres a millimetre of diameter up to which drops are drawn, so that density 1 stays in the budget."""
    a_metre = 8 * moment(3, rate, SMALLEST, LARGEST)  # drops drawn at a reach of 1
    return min(FARTHEST_REACH, float((BUDGET / a_metre) ** (1 / 3)))


def count(rate: float, density: float) -> int:
    """Drops drawn in a storm of `density` times as many drops as Marshall and Palmer counted."""
    return round(density * 8 * reach(rate) ** 3 * moment(3, rate, SMALLEST, LARGEST))


def draw_cloud(rate: float, density: float, wind: NDArray, turbulence: float, up: NDArray, seed: int) -> Cloud:
    """The drops of a storm. A denser storm of the same seed keeps the drops of a thinner one.

    Args:
        rate: mm/h.
        density: see `count`.
        wind: [3] m/s in the world's axes.
        turbulence: standard deviation in m/s of each component of a drop's velocity.
        up: [3] unit vector against gravity.
        seed: of everything drawn.
    """
    number = count(rate, density)
    uniform = generator(seed, "storm", "places").random((number, 4))
    gusts = generator(seed, "storm", "gusts").standard_normal((number, 3))
    diameters = _draw_diameters(rate, uniform[:, 3])
    periods = 2 * reach(rate) * diameters
    falling = -fall_speed(diameters)[:, None] * up
    return Cloud(uniform[:, :3] * periods[:, None], falling + wind + turbulence * gusts, diameters / 1000, periods)


def _draw_diameters(rate: float, uniform: NDArray) -> NDArray[np.float64]:
    """Diameters in mm: as many of each size as N(D) times the volume they are drawn in, which grows as D^3."""
    grid = np.linspace(SMALLEST, LARGEST, 2048)
    share = gammainc(4, slope(rate) * grid)
    return np.interp(uniform, (share - share[0]) / (share[-1] - share[0]), grid)


def optical_depth(rate: float, density: float, distances: NDArray) -> NDArray[np.float64]:
    """Mean cover by all drops that are not drawn one by one, added up to these distances in metres.

    Beyond DEEPEST there is no more rain.
    """
    return density * np.interp(distances, *_depth_table(rate))


@cache
def _depth_table(rate: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distances in metres, and the cover added up to each at density 1; the same for all views of a storm."""
    metres = np.concatenate([[0.0], np.geomspace(0.05, DEEPEST, 400)])
    sizes = np.maximum(metres / reach(rate), SMALLEST)  # what is larger is drawn, up to there
    sizes[metres >= LARGEST * reach(rate)] = 1000.0
    area = np.array([moment(2, rate, 0.0, size) for size in sizes]) * np.pi / 4 * 1e-6  # m^2 a cubic metre
    total = np.concatenate([[0.0], np.cumsum(np.diff(metres) * (area[1:] + area[:-1]) / 2)])
    return metres, total
