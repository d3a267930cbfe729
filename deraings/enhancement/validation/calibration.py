"""Predicted against true error of a network: means over tenths of the pixels, and their drawing."""

import math
from collections.abc import Mapping, Sequence
from xml.sax.saxutils import escape

import numpy as np

from deraings.image_planes import Plane

TENTHS = 10
LOW, HIGH = 0.002, 0.5  # encoded, ends of both axes, which are logarithmic
SIDE, MARGIN, LEGEND = 360, 46, 150  # pixels of the drawing
TICKS = 0.01, 0.1
COLOURS = "#1b6ca8", "#d1495b", "#2e8b57", "#8a5fb0", "#c98a1b", "#4d4d4d"

Curve = tuple[Sequence[float], Sequence[float]]  # means of predicted and of true errors


def calibration(predicted: Sequence[Plane], true: Sequence[Plane]) -> Curve:
    """Mean predicted and mean true error of each tenth of the pixels, in order of the predicted error.

    Args:
        predicted: mean absolute errors [H, W] that a network predicts of pictures, at least one.
        true: the errors of the same pictures.
    """
    flat = [np.concatenate([plane.ravel() for plane in planes]) for planes in (predicted, true)]
    order = np.argsort(flat[0], kind="stable")
    means = ([round(float(part.mean()), 5) for part in np.array_split(errors[order], TENTHS)] for errors in flat)
    expected, found = means
    return expected, found


def draw_calibration(curves: Mapping[str, Curve]) -> str:
    """An SVG of calibration curves by name; a network without fault has them on the diagonal."""
    end = SIDE - MARGIN
    lines = [f'<line x1="{MARGIN}" y1="{end}" x2="{end}" y2="{MARGIN}" stroke="#999" stroke-dasharray="4 4"/>']
    lines.append(
        f'<rect x="{MARGIN}" y="{MARGIN}" width="{end - MARGIN}" height="{end - MARGIN}" fill="none" stroke="#999"/>'
    )
    for tick in TICKS:
        place = _place(tick)
        lines.append(f'<text x="{place:.1f}" y="{end + 16}" text-anchor="middle">{tick}</text>')
        lines.append(f'<text x="{MARGIN - 6}" y="{SIDE - place + 4:.1f}" text-anchor="end">{tick}</text>')
    lines.append(f'<text x="{SIDE / 2}" y="{SIDE - 8}" text-anchor="middle">predicted error</text>')
    lines.append(f'<text transform="translate(14 {SIDE / 2}) rotate(-90)" text-anchor="middle">true error</text>')
    for number, (name, (predicted, true)) in enumerate(curves.items()):
        colour, height = COLOURS[number % len(COLOURS)], MARGIN + 18 * number
        corners = " ".join(f"{_place(x):.1f},{SIDE - _place(y):.1f}" for x, y in zip(predicted, true, strict=True))
        lines.append(f'<polyline points="{corners}" fill="none" stroke="{colour}" stroke-width="2"/>')
        lines.append(f'<text x="{end + 10}" y="{height + 10}" fill="{colour}">{escape(name)}</text>')
    text = 'font-family="sans-serif" font-size="12"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE + LEGEND} {SIDE}" {text}>'
    return "\n".join([head, '<rect width="100%" height="100%" fill="#fff"/>', *lines, "</svg>", ""])


def _place(error: float) -> float:
    """Pixels from the left, or from below, of an error on an axis."""
    share = math.log(min(max(error, LOW), HIGH) / LOW) / math.log(HIGH / LOW)
    return MARGIN + share * (SIDE - 2 * MARGIN)
