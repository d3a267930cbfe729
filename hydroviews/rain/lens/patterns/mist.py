"""Mist on the lens: a smooth veil that covers part of the view with light from all around."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.patterns.fields import surface
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.lens.patterns.runs import draw_rivulets
from hydroviews.rain.lens.patterns.water import place_drops
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.scene.seeds import generator

BLOBS = (5, 9, 17)  # knots of the random surfaces along a side
SHARES = (0.5, 0.3, 0.2)  # of each
DRIFT = 0.08  # sides that mist moves from the first view to the last
FINEST = 160  # pixels along the longer side at which trails are wiped; mist has no finer detail
WIPED = 0.75  # share of the mist that a running drop takes along
STEEPNESS = 7.0  # exponent of a pane's mist: thin over most of the picture, thick in a few regions
WIPES = 1.6  # half the width of what a running drop wipes off a pane, in its radii
HALO = 1.8  # radius of what a larger drop has taken up around it, in its own
EDGE = 0.002  # sides over which a pane's wiped edges are soft
SUBPIXEL = 16  # parts of a pixel in which wiped places are drawn


def mist_veil(pattern: RaindropPattern, width: int, height: int, moment: float) -> NDArray[np.float32]:
    """The share V of each pixel's light that mist replaces, R = (1 - V) B + V air in linear light.

    Dense on one side, thin on the other, with clouds of a few sizes; where drops have run it is wiped thin. Its form
    does not depend on `pattern.mist`, nor, but for sampling, on the picture's size.

    Args:
        pattern: the rain; its `mist` is the largest V.
        width: of the picture in pixels.
        height: of the picture in pixels.
        moment: 0 at the first view, 1 at the last.

    Returns:
        [height, width], in [0, pattern.mist].
    """
    if pattern.mist <= 0:
        return np.zeros((height, width), np.float32)
    side = np.sqrt(width * height)
    shrink = max(1.0, max(width, height) / FINEST)
    columns, rows = max(1, round(width / shrink)), max(1, round(height / shrink))
    x = (np.arange(columns) + 0.5) / columns * width / side
    y = (np.arange(rows) + 0.5) / rows * height / side
    form = _form(pattern.seed, (width / side, height / side), x, y, moment)
    veil = form * (1 - WIPED * _wiped(pattern, (width / side, height / side), x, y, moment))
    fine = cv2.resize(veil.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(pattern.mist * np.clip(fine, 0, 1), np.float32)


def _form(seed: int, extent: tuple[float, float], x: NDArray, y: NDArray, moment: float) -> NDArray[np.float64]:
    """The veil before wiping [rows, columns], in [0, 1]."""
    rng = generator(seed, "mist")
    direction, drift = rng.uniform(0, 2 * np.pi, 2)
    x = x + DRIFT * moment * np.cos(drift)
    y = y + DRIFT * moment * np.sin(drift)
    across = (x / extent[0] - 0.5) * np.cos(direction)
    along = (y / extent[1] - 0.5) * np.sin(direction)
    clouds = np.zeros((len(y), len(x)))
    for knots, share in zip(BLOBS, SHARES, strict=True):
        grid = rng.uniform(-1, 1, (2 * knots, 2 * knots))
        clouds += share * surface(grid, x * knots / 2 + 1, y * knots / 2 + 1)
    dense = np.clip(0.55 + 0.75 * (along[:, None] + across[None]) + 0.9 * clouds, 0, 1)
    return np.asarray(dense**2 * (3 - 2 * dense))


def _wiped(
    pattern: RaindropPattern, extent: tuple[float, float], x: NDArray, y: NDArray, moment: float
) -> NDArray[np.float64]:
    """How much of the mist running drops have taken along, [rows, columns] in [0, 1]."""
    wiped = np.zeros((len(y), len(x)))
    for rivulet in draw_rivulets(pattern, extent, moment):
        way, reach = rivulet.way, 1.3 * rivulet.start_radius
        for px, py in way[:: max(1, int(reach / 2 / 0.004))]:
            square = ((x - px) / reach)[None] ** 2 + ((y - py) / reach)[:, None] ** 2
            np.maximum(wiped, np.exp(-(square**2)), out=wiped)
    return wiped


def window_mist(pattern: WindowPattern, width: int, height: int, moment: float) -> NDArray[np.float32]:
    """The share V [height, width] of each pixel's light that mist on a pane replaces, in [0, pattern.mist].

    Thick in some regions, absent from others; larger drops and runs have wiped what was around them, with edges of a
    pixel or two. Arguments as for `mist_veil`.
    """
    side = float(np.sqrt(width * height))
    x, y = (np.arange(width) + 0.5) / side, (np.arange(height) + 0.5) / side
    form = _form(pattern.seed, (width / side, height / side), x, y, moment) ** STEEPNESS
    clear = np.zeros((height, width), np.float32)
    extent = (width / side, height / side)
    for rivulet in draw_rivulets(pattern, extent, moment):
        line = np.round(rivulet.way * side * SUBPIXEL).astype(np.int32)
        thick = max(1, round(2 * WIPES * rivulet.start_radius * side))
        cv2.polylines(clear, [line], False, (1.0,), thick, cv2.LINE_AA, SUBPIXEL.bit_length() - 1)
    for drop in place_drops(pattern, extent):
        for cx, cy, radius in drop.outline.disks:
            middle = (round(cx * side * SUBPIXEL), round(cy * side * SUBPIXEL))
            reach = round(HALO * radius * side * SUBPIXEL)
            cv2.circle(clear, middle, reach, (WIPED,), cv2.FILLED, cv2.LINE_AA, SUBPIXEL.bit_length() - 1)
    wiped = np.clip(cv2.GaussianBlur(clear, (0, 0), EDGE * side), 0, 1)
    return np.asarray(pattern.mist * form * (1 - WIPED * wiped), np.float32)
