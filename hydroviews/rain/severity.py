"""How hard a pattern should be: its strength is set so that plain 3DGS loses about as much as its grade says.

What 3DGS makes of rain can be predicted, roughly: `streaks.severity` and `lens.severity` say how for their effects. A
scene is learned from clean views with an error in proportion to its fine detail; where that ratio has been measured, it
is used. The loss in dB is 10 log10(1 + harm / error).

The loss that was really measured stands in the data card of each built scene, which is where a grade is judged.
"""

from collections.abc import Callable

from hydroviews.rain.scene_statistics import SceneStatistics

CLEAN_ERROR = 1.5  # mean squared error of a scene learned from clean views, in units of its fine detail, if not known
MOST_BY_DROPS = 0.7  # share of a grade's harm that drops on the lens may do; the rest is mist's, which no pattern lacks
STEPS = 12  # of a bisection


def wanted_harm(loss: float, statistics: SceneStatistics) -> float:
    """Mean squared error, in encoded values, that rain must leave in what is learned to cost `loss` dB."""
    return float((statistics.clean_error or CLEAN_ERROR) * statistics.detail * (10 ** (loss / 10) - 1))


def solve(increasing: Callable[[float], float], wanted: float, low: float, high: float) -> float:
    """Where a function that grows from `low` to `high` takes the wanted value, or the end nearest to that.

    Not scipy's brentq: the harm of streaks jumps where a seed comes in, and the data sets that are built have the
    values of this bisection, to the last bit.
    """
    if increasing(high) <= wanted:
        return high
    if increasing(low) >= wanted:
        return low
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if increasing(middle) < wanted else (low, middle)
    return (low + high) / 2
