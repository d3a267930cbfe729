"""What rain of another make costs: milliseconds of processor time a view, on one thread.

    python -m benchmarks.other_make --out results/bench

Prints a table and writes other-make.csv. "kept" is a view of a key frame that is held, "new" one whose key frame is
drawn first, as every view has it in patterns with one a view. Times are the least of several turns.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from tqdm import tqdm

from benchmarks.timing import least
from hydroviews.cli.commands import run_command
from hydroviews.files.atomic import write_bytes
from hydroviews.rain.effect import fall
from hydroviews.rain.other_make import drops, rainfall
from hydroviews.rain.other_make.raindrop import OtherRaindrops, PreparedLens
from hydroviews.rain.patterns import GRADES
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View
from hydroviews.scene.seeds import generator

SIZES = ((320, 240), (400, 300), (800, 600))
STROKES = (1000, 3000, int(rainfall.MOST))
VIEW = "view"
DOWN = np.array([0.0, 1, 0])


def costs(size: tuple[int, int], repeats: int) -> Iterator[dict[str, Any]]:
    """Rows of one size of picture: whole views, from the clean picture to the rainy one."""
    width, height = size
    camera = Camera(width, height, 1.2 * width, 1.2 * width, width / 2, height / 2, np.eye(4))
    clean = generator(0, "picture").random((height, width, 3), np.float32)
    for level, grade in enumerate(GRADES):
        pattern = replace(drops.draw_pattern(generator(1, "lens"), level), mist=0.3, key_frames=1)
        held = PreparedLens(pattern, [VIEW], camera)
        kept = least(partial(wet, held, clean), repeats)
        new = least(partial(wet_anew, pattern, camera, clean), repeats)
        yield {"size": f"{width}x{height}", "rain": f"drops, {grade}", "kept": kept, "new": new}
    for strokes in STROKES:
        falling = replace(rainfall.draw_pattern(generator(1, "rain")), strokes=float(strokes), veil=0.1)
        new = least(partial(streaked, falling, camera, clean), repeats)
        yield {"size": f"{width}x{height}", "rain": f"{strokes} strokes", "new": new}


def wet(rain: PreparedLens, clean: Image) -> Image:
    """A view behind a lens."""
    view = View(VIEW, rain.camera, Path(f"{VIEW}.png"))
    return OtherRaindrops().composite({}, clean, fall(rain, clean, view))


def wet_anew(pattern: drops.LensPattern, camera: Camera, clean: Image) -> Image:
    """The same with the lens drawn first."""
    return wet(PreparedLens(pattern, [VIEW], camera), clean)


def streaked(pattern: rainfall.RainfallPattern, camera: Camera, clean: Image) -> Image:
    """A view in falling rain."""
    streaks = rainfall.draw_rainfall(pattern, camera, DOWN, generator(2, VIEW))
    veil = rainfall.veil_cover(pattern, camera.width, camera.height)
    return rainfall.rain_over(clean, streaks, veil, pattern.screen, rainfall.sky_colour(clean))


def main(out: Path = Path("results/bench"), repeats: int = 7) -> None:
    """Measure and report.

    Args:
        out: where the CSV file goes.
        repeats: timed turns of each case.
    """
    cv2.setNumThreads(1)
    rows = [row for size in tqdm(SIZES, desc="sizes", leave=False) for row in costs(size, repeats)]
    table = pd.DataFrame(rows).round(1)
    print(table.to_string(index=False))
    write_bytes(out / "other-make.csv", table.to_csv(index=False).encode())


if __name__ == "__main__":
    run_command(main, prog="benchmarks.other_make")
