"""Drops through a camera's shutter: projected, motion-blurred, out of focus, hidden by what is nearer.

A drop of d pixels in diameter that crosses a picture while the shutter is open covers, averaged over the exposure,
its own area pi d^2 / 4 and no more, however long its streak. That area is spread over the streak: evenly along it, and
across it over the width of the drop, its defocus and a pixel. So longer streaks are fainter, and a drop finer than
a pixel is fainter, not thinner.

`reference` follows the drops through the exposure instead. No fast-math flags: the same drops give the same
bits whenever and wherever the kernels were compiled.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.storm.drop_sizes import Cloud
from hydroviews.scene.cameras import Camera

NEAREST = 0.1  # metres: drops nearer to the lens are not drawn
FINEST = 0.7  # pixels: the least width of a drop, before a pixel's own width is added
BOX = 0.75  # a disk is as wide, in variance, as a square of sqrt(BOX) times its diameter
Point = tuple[float, float, float]
FIELDS = 8  # of a streak: middle x, y; direction x, y; length, width, area in pixels; depth in metres


@dataclass(frozen=True)
class Shutter:
    """How a camera takes one picture."""

    time: float  # seconds, when it opens
    exposure: float  # seconds
    aperture: float  # metres, diameter of the lens's opening
    focus: float  # metres, depth in focus


def project(cloud: Cloud, camera: Camera, shutter: Shutter) -> NDArray[np.float64]:
    """The streaks [N, FIELDS] of all drops that cross the picture, in the order of the cloud.

    Args:
        cloud: the drops.
        camera: its pose in metres.
        shutter: when and how.
    """
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height], np.float64)
    shot = np.array([shutter.time, shutter.exposure, shutter.aperture, shutter.focus], np.float64)
    return _project(
        cloud.positions, cloud.velocities, cloud.diameters, cloud.periods, camera.rotation, camera.centre, lens, shot
    )


def draw(streaks: NDArray[np.float64], depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Cover [H, W] in [0, 1] by streaks [N, FIELDS] in front of surfaces at `depth` [H, W] metres."""
    clear = np.ones(depth.shape, np.float32)
    _draw(streaks, np.ascontiguousarray(depth, np.float32), clear)
    return 1 - clear


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project(
    positions: NDArray,
    velocities: NDArray,
    diameters: NDArray,
    periods: NDArray,
    rotation: NDArray,
    centre: NDArray,
    lens: NDArray,
    shot: NDArray,
) -> NDArray:
    time, exposure = shot[0], shot[1]
    streaks = np.empty((len(diameters), FIELDS))
    kept = 0
    at, moved = np.empty(3), np.empty(3)
    for i in range(len(diameters)):
        period, squared = periods[i], 0.0
        for k in range(3):  # the copy nearest to the camera
            offset = positions[i, k] + velocities[i, k] * time - centre[k]
            at[k] = offset - period * np.floor(offset / period + 0.5)
            moved[k] = at[k] + velocities[i, k] * exposure
            squared += at[k] * at[k]
        if 4 * squared > period * period:
            continue
        z0, z1 = _turned(rotation, 2, at), _turned(rotation, 2, moved)
        if z0 < NEAREST and z1 < NEAREST:
            continue
        x0, x1 = _turned(rotation, 0, at), _turned(rotation, 0, moved)
        y0, y1 = _turned(rotation, 1, at), _turned(rotation, 1, moved)
        kept += _write_streak(streaks[kept], (x0, y0, z0), (x1, y1, z1), diameters[i], lens, shot)
    return streaks[:kept].copy()


@numba.njit(inline="always", error_model="numpy")
def _turned(rotation: NDArray, axis: int, place: NDArray) -> float:
    return rotation[axis, 0] * place[0] + rotation[axis, 1] * place[1] + rotation[axis, 2] * place[2]


@numba.njit(inline="always", error_model="numpy")
def _write_streak(streak: NDArray, opened: Point, closed: Point, diameter: float, lens: NDArray, shot: NDArray) -> bool:
    """The streak of a drop from where the shutter opens to where it closes, in camera axes; False if not in view.

    At least one of the two is beyond the nearest depth.
    """
    fx, fy, cx, cy, width, height = lens
    aperture, focus = shot[2], shot[3]
    rise = closed[2] - opened[2]
    start, stop = 0.0, 1.0  # the part of the exposure spent beyond the nearest depth
    if opened[2] < NEAREST:
        start = (NEAREST - opened[2]) / rise
    if closed[2] < NEAREST:
        stop = (NEAREST - opened[2]) / rise
    za, zb = opened[2] + rise * start, opened[2] + rise * stop
    xa = fx * (opened[0] + (closed[0] - opened[0]) * start) / za + cx
    ya = fy * (opened[1] + (closed[1] - opened[1]) * start) / za + cy
    xb = fx * (opened[0] + (closed[0] - opened[0]) * stop) / zb + cx
    yb = fy * (opened[1] + (closed[1] - opened[1]) * stop) / zb + cy
    z, focal = (za + zb) / 2, np.sqrt(fx * fy)
    across = focal * diameter / z
    blur = aperture * focal * abs(1 / z - 1 / focus)
    breadth = max(FINEST, np.sqrt(BOX * (across * across + blur * blur)))
    margin = breadth + 1
    beside = min(xa, xb) > width + margin or max(xa, xb) < -margin
    if beside or min(ya, yb) > height + margin or max(ya, yb) < -margin:
        return False
    length = np.sqrt((xb - xa) * (xb - xa) + (yb - ya) * (yb - ya))
    streak[0], streak[1] = (xa + xb) / 2, (ya + yb) / 2
    streak[2] = (xb - xa) / length if length > 1e-6 else 0.0
    streak[3] = (yb - ya) / length if length > 1e-6 else 1.0
    streak[4], streak[5] = length, breadth
    streak[6] = np.pi / 4 * across * across * (stop - start)
    streak[7] = z
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw(streaks: NDArray, depth: NDArray, clear: NDArray) -> None:
    """Multiply what stays clear of each streak into `clear` [H, W]; trapezia along and across, of the area's sum."""
    height, width = clear.shape
    for i in range(len(streaks)):
        middle_x, middle_y, along_x, along_y, length, breadth, area, z = streaks[i]
        end = np.sqrt(breadth * breadth + 1)  # a streak's ends fade over the drop's width and a pixel
        far, near = length, end
        if length < end:  # hardly a streak: a rectangle along the pixels, as long in variance
            sideways = abs(along_x) > abs(along_y)
            along_x, along_y = (1.0, 0.0) if sideways else (0.0, 1.0)
            far, near = np.sqrt(length * length + breadth * breadth), 1.0
            far, near = max(far, near), min(far, near)
        half_length, half_breadth = (far + near) / 2, (breadth + 1) / 2
        broad, narrow = max(breadth, 1.0), min(breadth, 1.0)
        peak = area / (far * broad)
        slope_length, slope_breadth = 1 / near, 1 / narrow
        reach_y = abs(along_y) * half_length + abs(along_x) * half_breadth
        first = max(0, int(np.floor(middle_y - reach_y)))
        last = min(height - 1, int(np.floor(middle_y + reach_y)))
        for row in range(first, last + 1):
            y = row + 0.5 - middle_y
            low, high = -middle_x, width - middle_x
            if abs(along_y) > 1e-9:  # |x along_y - y along_x| < half_breadth
                centre, span = y * along_x / along_y, half_breadth / abs(along_y)
                low, high = max(low, centre - span), min(high, centre + span)
            if abs(along_x) > 1e-9:  # |x along_x + y along_y| < half_length
                centre, span = -y * along_y / along_x, half_length / abs(along_x)
                low, high = max(low, centre - span), min(high, centre + span)
            left = max(0, int(np.floor(low + middle_x)))
            right = min(width - 1, int(np.floor(high + middle_x)))
            for column in range(left, right + 1):
                if z >= depth[row, column]:
                    continue
                x = column + 0.5 - middle_x
                across = (half_breadth - abs(x * along_y - y * along_x)) * slope_breadth
                along = (half_length - abs(x * along_x + y * along_y)) * slope_length
                cover = peak * min(max(across, 0.0), 1.0) * min(max(along, 0.0), 1.0)
                clear[row, column] *= 1 - min(cover, 1.0)
