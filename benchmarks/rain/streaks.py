"""Speed and error of falling rain: streaks of the 2D recipe, and drops of a storm.

    python -m benchmarks streaks --out results/bench

Prints three tables and writes streaks-2d.csv, streaks-storm.csv and streaks-storm-error.csv. Everything runs on one
thread; times are processor time, the least of several turns, so that what else runs on the machine counts little.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from benchmarks.tables import report, rows_of
from benchmarks.timing import least
from hydroviews.rain.storm import reference as storm_reference
from hydroviews.rain.storm.drop_sizes import count, draw_cloud
from hydroviews.rain.storm.rasterise import Shutter, draw, project
from hydroviews.rain.streaks import recipe as streaks
from hydroviews.rain.streaks import reference as streaks_reference
from hydroviews.rain.streaks.convolution import convolve
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator

PATTERNS = ((100, 20, 40.0, 3), (200, 30, 90.0, 5), (300, 40, 120.0, 7))  # n, l, theta, w
SIZES_2D = ((801, 533), (1000, 1000), (1600, 1067))
SIZES_3D = ((400, 300), (800, 600), (1600, 1200))
DROPS = (10_000, 60_000, 200_000, 800_000)
IN_VIEW = 60_000
RATE = 30.0  # mm/h
UP = np.array([0, -0.8, 0.6])
WIND = np.array([2.0, 0, 0])
ERROR_CASES = ((0.01, 0.004), (0.01, 0.0), (0.002, 0.004), (1 / 60, 0.004))  # exposure in s, aperture in m


def recipe(pattern: tuple[int, int, float, int], size: tuple[int, int], repeats: int) -> dict[str, Any]:
    """One pattern drawn by us, by OpenCV and by FFT: milliseconds a megapixel, and error against float64."""
    n, length, angle, width = pattern
    k = streaks.kernel(length, angle, width)
    image, megapixels = streaks.seed_image(k), size[0] * size[1] / 1e6
    noise = streaks.noise(n, *size, generator(0))
    exact = streaks_reference.drawing(noise, length, angle, width)
    ways: dict[str, Callable[[], NDArray]] = {
        "ours": lambda: convolve(streaks.draw_seeds(n, *size, generator(0)), image, *size),
        "filter2D": lambda: cv2.filter2D(cv2.filter2D(noise, -1, streaks.PRE_BLUR), -1, k),
        "fft": lambda: by_fft(noise, image),
    }
    row: dict[str, Any] = {"size": f"{size[0]}x{size[1]}", "n": n, "l": length, "theta": angle, "w": width}
    row["ms/MP noise, every pixel"] = least(lambda: every_pixel(n, *size), repeats) / megapixels
    for name, way in ways.items():
        row[f"ms/MP {name}"] = least(way, repeats) / megapixels
        row[f"error {name}"] = float(np.abs(streaks.normalised(way()) - exact).max())
    layer = streaks.StreakPattern(n, length, angle, width)
    row["ms/MP whole layer"] = least(lambda: streaks.streak_layer(layer, *size, generator(0)), repeats) / megapixels
    return row


def every_pixel(n: float, width: int, height: int) -> NDArray:
    """The noise as the recipe has it, for its cost."""
    values = generator(0).uniform(0, 256, (height, width)).astype(np.float32)
    values[values < 256 - n / 100] = 0
    return values


def by_fft(noise: NDArray, image: NDArray) -> NDArray:
    """The same correlation through Fourier space, in single precision."""
    before, after = len(image) // 2, len(image) - 1 - len(image) // 2
    around = np.pad(noise, ((before, after), (before, after)), mode="reflect")
    return np.asarray(fftconvolve(around, image[::-1, ::-1].astype(np.float32), mode="valid"))


def view(width: int, height: int) -> Camera:
    """A lens with a horizontal field of 58 degrees."""
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, np.eye(4))


def storm(drops: int, size: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Milliseconds to project and to draw a storm of so many drops."""
    camera, shutter = view(*size), Shutter(2.0, 0.01, 0.004, 4.0)
    cloud = draw_cloud(RATE, drops / count(RATE, 1), WIND, 0.3, UP, 0)
    depth = np.full(size[::-1], np.inf, np.float32)
    seen = project(cloud, camera, shutter)
    row: dict[str, Any] = {"size": f"{size[0]}x{size[1]}", "drops": len(cloud), "in view": len(seen)}
    row["project ms"] = least(lambda: project(cloud, camera, shutter), repeats)
    row["draw ms"] = least(lambda: draw(seen, depth), repeats)
    return {**row, "ms": row["project ms"] + row["draw ms"]}


def all_in_view(size: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Milliseconds to draw IN_VIEW streaks that all cross the picture: those of several storms together."""
    camera, depth = view(*size), np.full(size[::-1], np.inf, np.float32)
    cloud = draw_cloud(RATE, 4, WIND, 0.3, UP, 0)
    seen: list[NDArray] = []
    while sum(map(len, seen)) < IN_VIEW:
        seen.append(project(cloud, camera, Shutter(7.0 * len(seen), 0.01, 0.004, 4.0)))
    streaks_in_view = np.concatenate(seen)[:IN_VIEW]
    row = {"size": f"{size[0]}x{size[1]}", "drops": IN_VIEW, "in view": IN_VIEW}
    milliseconds = least(lambda: draw(streaks_in_view, depth), repeats)
    return {**row, "draw ms": milliseconds, "ms": milliseconds}


def storm_error(exposure: float, aperture: float, size: tuple[int, int] = (200, 150)) -> dict[str, Any]:
    """Cover against drops that are followed through the exposure in float64."""
    camera, shutter = view(*size), Shutter(2.0, exposure, aperture, 4.0)
    cloud = draw_cloud(RATE, 0.5, WIND, 0.3, UP, 0)
    depth = np.full(size[::-1], np.inf, np.float32)
    fast = draw(project(cloud, camera, shutter), depth).astype(np.float64)
    slow = storm_reference.cover(cloud, camera, shutter, depth)
    row = {"size": f"{size[0]}x{size[1]}", "exposure s": round(exposure, 4), "aperture m": aperture}
    return {
        **row,
        "largest cover": slow.max(),
        "largest error": np.abs(fast - slow).max(),
        "rms error": np.sqrt(np.mean((fast - slow) ** 2)),
        "mean cover": slow.mean(),
        "its relative error": fast.mean() / slow.mean() - 1,
    }


def main(out: Path = Path("results/bench"), repeats: int = 7) -> None:
    """Measure and report.

    Args:
        out: where the CSV files go.
        repeats: timed turns of each case.
    """
    cv2.setNumThreads(1)
    flat = rows_of(recipe, [(p, size, repeats) for size in SIZES_2D for p in PATTERNS], "2d")
    storms = rows_of(storm, [(n, size, repeats) for size in SIZES_3D for n in DROPS], "storm")
    filled = rows_of(all_in_view, [(size, repeats) for size in SIZES_3D], "storm")
    tables = {
        "2d": flat,
        "storm": pd.concat([storms, filled]),
        "storm-error": rows_of(storm_error, ERROR_CASES, "error"),
    }
    for name, table in tables.items():
        report(table, out / f"streaks-{name}.csv", name)
