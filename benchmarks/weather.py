"""Speed and error of haze and darkness, against their formulas in float64.

    python -m benchmarks.weather --out results/bench

Prints a table and writes weather.csv. Everything runs on one thread; times are processor time, the least of several
turns. Depth is at hand: reading or gathering it is not counted.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from benchmarks.timing import least
from hydroviews.cli.commands import run_command
from hydroviews.files.atomic import write_bytes
from hydroviews.rain.effect import fall
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import Light, SceneStatistics
from hydroviews.rain.weather import haze, reference
from hydroviews.rain.weather.dark import AmbientPattern, Dark, DarkPattern
from hydroviews.rain.weather.noise import PLANES, NoisePattern
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View, no_points

SIZES = ((400, 300), (800, 600), (1600, 1200))
AMBIENT = AmbientPattern(stops=1.5, flatness=0.05, tint=(0.97, 1.0, 1.03), pivot=0.2)
NOISE = NoisePattern(shot=5e-4, read=1e-3)


def measure(width: int, height: int, repeats: int) -> list[dict[str, Any]]:
    """Milliseconds a view, and the largest error of an encoded value, for both effects."""
    clean = np.random.default_rng(0).integers(0, 256, (height, width, 3)).astype(np.float32) / 255
    camera = Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, np.eye(4))
    view = View("view", camera, Path("images/view.png"))
    statistics = _scene(view)
    optical_depth = 0.05 * np.linspace(1, 60, width * height, dtype=np.float32).reshape(height, width)

    hidden = haze.veil(optical_depth, clean)
    air = haze.Haze().place(haze.HazePattern(0.05, (0.95, 0.97, 1.0)), Pattern("haze", 0), statistics).parameters
    rounded = {"H": hidden.astype(np.float16).astype(np.float32)}

    def hazy() -> Image:
        layers = {"H": haze.veil(optical_depth, clean).astype(np.float16).astype(np.float32)}
        return haze.Haze().composite(air, clean, layers)

    sensor = Dark().place(DarkPattern(AMBIENT, NOISE), Pattern("dark", 0), statistics)
    chance = fall(sensor, clean, view)

    def dark() -> Image:
        return Dark().composite(sensor.parameters, clean, fall(sensor, clean, view))

    planes = np.stack([chance[name] for name in PLANES], axis=-1)
    exact = {
        "haze": reference.hazy(clean, rounded["H"], air["airlight"]),
        "dark": reference.dark(clean, planes, AMBIENT, NOISE),
    }
    return [
        {
            "effect": name,
            "size": f"{width}x{height}",
            "ms a view": least(way, repeats),
            "error": float(np.abs(way() - exact[name]).max()),
        }
        for name, way in (("haze", hazy), ("dark", dark))
    ]


def _scene(view: View) -> SceneStatistics:
    light = Light(mean=(0.2, 0.2, 0.2), air=(0.7, 0.72, 0.75))
    return SceneStatistics("bench", 0, (view,), no_points(), 1.0, (), 0.0, light, metres_per_unit=1.0)


def main(out: Path = Path("results/bench"), repeats: int = 20) -> None:
    """Measure all sizes.

    Args:
        out: gets the table.
        repeats: turns, of which the least counts.
    """
    cv2.setNumThreads(1)
    table = pd.DataFrame([row for size in SIZES for row in measure(*size, repeats)])
    print(table.to_string(index=False, float_format=lambda value: f"{value:.3g}"))
    write_bytes(out / "weather.csv", table.to_csv(index=False).encode())


if __name__ == "__main__":
    run_command(main, "benchmarks.weather")
