"""The frame of a drawing: where numbers stand in it, and which of them are written at its axes."""

import math

WIDTH, HEIGHT = 420, 280  # of a drawing, in its own units
LEFT, RIGHT, TOP, BOTTOM = 46, 16, 16, 40
STEPS = (1, 2, 5)

Span = tuple[float, float]  # the least and the largest number of an axis
Ticks = tuple[tuple[float, str], ...]  # places along an axis, and what is written there


def across(value: float, span: Span) -> float:
    """Where a number stands from the left."""
    return round(LEFT + (value - span[0]) / (span[1] - span[0]) * (WIDTH - LEFT - RIGHT), 1)


def up(value: float, span: Span) -> float:
    """Where a number stands from the top, larger ones further up."""
    return round(HEIGHT - BOTTOM - (value - span[0]) / (span[1] - span[0]) * (HEIGHT - TOP - BOTTOM), 1)


def widened(low: float, high: float, share: float) -> Span:
    """A span with room on both sides, of a share of it, and never empty."""
    room = max((high - low) * share, 0.01 * max(abs(low), abs(high)), 1e-6)
    return low - room, high + room


def log_ticks(low: float, high: float) -> list[float]:
    """Of a logarithmic axis; equally far in value where it is short."""
    if high / low < 10:
        return ticks(low, high)
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = STEPS if high / low < 100 else (1,)
    return [step * 10.0**e for e in exponents for step in steps if low <= step * 10.0**e <= high]


def ticks(low: float, high: float) -> list[float]:
    """Of an axis: three or more round numbers."""
    most = (high - low) / 3
    size = 10 ** math.floor(math.log10(most))
    step = max((s * size for s in STEPS if s * size <= most), default=size)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(i * step, 6) for i in range(first, last + 1)]
