"""The look of wet panes: the statistics that are known of published pictures, measured on ours.

    python -m benchmarks window_look --captures ../shared/data --out results/bench
    python -m benchmarks window_look --rainy rainy.png --clean clean.png

Prints a table and writes window_look.csv and window_look.png: three patterns of every capture, 300x200 pixels each. All
is measured at 702 pixels of width, in encoded grey values. Least squares give the line of rainy on clean around every
pixel, in a window of a tenth of the width. Pixels whose window shows hardly any contrast do not count.
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.tables import report
from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.formats.read import read_scene
from hydroviews.rain.effect import fall
from hydroviews.rain.lens.window import WindowEffect
from hydroviews.rain.patterns import GRADES, Pattern
from hydroviews.rain.scene_statistics import survey
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, luminance, read_image

Plane = NDArray[np.float32]
SIZE, SHOWN = (702, 468), (300, 200)  # pixels, measured and drawn
STATISTICS_SIDE = 320  # pixels, of the views that patterns are fitted to
WINDOW = 0.1  # widths
CONTRAST = 0.03  # standard deviation of a window of the clean view, encoded
OFF = 0.07  # from the local line, encoded: a changed pixel
SMALLEST = 4  # pixels of a spot


def measure(rainy: Image, clean: Image) -> dict[str, float]:
    """The look of one rainy view [H, W, 3] of a clean one, both encoded: see the columns of the table."""
    seen, scene = (np.asarray(luminance(picture), np.float32) for picture in (rainy, clean))
    slope, intercept, spread = local_line(seen, scene)
    counted = spread > CONTRAST
    low, middle, high = np.quantile(slope[counted], [0.1, 0.5, 0.9])
    misty = counted & (slope < 0.9) & (slope > 0)
    veil = np.median(intercept[misty] / (1 - slope[misty])) if misty.any() else np.nan
    off = seen - (slope * scene + intercept)
    radii = spot_radii(off)
    return {
        "slope 10 %": float(low),
        "slope 50 %": float(middle),
        "slope 90 %": float(high),
        "veil": float(veil),
        "psnr": float(-10 * np.log10(np.mean((rainy - clean) ** 2, dtype=np.float64))),
        "changed": float((np.abs(off) > OFF).mean()),
        "radius 50 %": float(np.median(radii)) if len(radii) else np.nan,
        "radius 95 %": float(np.quantile(radii, 0.95)) if len(radii) else np.nan,
        "spots": len(radii),
    }


def local_line(seen: Plane, scene: Plane) -> tuple[Plane, Plane, Plane]:
    """Slope and intercept of the line of `seen` on `scene` around each pixel, and the deviation of `scene` there."""
    side = max(3, round(WINDOW * scene.shape[1])) | 1

    def mean(plane: Plane) -> NDArray[np.float64]:
        return np.asarray(cv2.blur(plane.astype(np.float64), (side, side), borderType=cv2.BORDER_REFLECT))

    variance = np.maximum(mean(scene**2) - mean(scene) ** 2, 1e-6)
    slope = (mean(seen * scene) - mean(seen) * mean(scene)) / variance
    intercept = mean(seen) - slope * mean(scene)
    slope, intercept, spread = (p.astype(np.float32) for p in (slope, intercept, np.sqrt(variance)))
    return slope, intercept, spread


def spot_radii(off: Plane) -> NDArray[np.float64]:
    """Radii, in widths, of the separate bright and dark spots of what is off the local line."""
    areas = []
    for spots in (off > OFF, off < -OFF):
        _, _, stats, _ = cv2.connectedComponentsWithStats(spots.astype(np.uint8), connectivity=4)
        areas.append(stats[1:, cv2.CC_STAT_AREA])
    area = np.concatenate(areas)
    return np.asarray(np.sqrt(area[area >= SMALLEST] / np.pi) / off.shape[1])


def pictured(image: Image, size: tuple[int, int]) -> Image:
    """A picture scaled and cut to a size."""
    scale = max(size[0] / image.shape[1], size[1] / image.shape[0])
    grown = [max(side, round(old * scale)) for side, old in zip(size, image.shape[1::-1], strict=True)]
    whole = cv2.resize(image, grown, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    return np.clip(np.asarray(whole[: size[1], : size[0]], np.float32), 0, 1)


def panes(capture: Path, seed: int, folder: Path) -> list[tuple[str, Image, Image]]:
    """For each grade the pane's kind, and a view of a capture rainy and clean."""
    scene = read_scene(capture).resized(STATISTICS_SIDE)
    statistics, effect = survey(scene, seed), WindowEffect()
    view = scene.views[len(scene.views) // 3]
    clean = pictured(read_image(view.path), SIZE)
    focal = view.camera.fx / view.camera.width * SIZE[0]
    camera = Camera(*SIZE, focal, focal, SIZE[0] / 2, SIZE[1] / 2, np.eye(4))
    found = []
    for index in range(len(GRADES)):
        pattern = Pattern("window", index)
        drawn = effect.draw(pattern, statistics)
        rain = effect.place(drawn, pattern, statistics)
        layers = fall(rain.prepare(camera, folder / pattern.name), clean, replace(view, camera=camera))
        found.append((drawn.kind, effect.composite(rain.parameters, clean, layers), clean))
    return found


def side_by_side(rows: list[list[Image]]) -> NDArray[np.uint8]:
    """Pictures in rows, drawn at SHOWN pixels, as BGR bytes."""
    drawn = [np.hstack([pictured(picture, SHOWN) for picture in row]) for row in rows]
    return np.asarray(np.vstack(drawn)[..., ::-1] * 255 + 0.5, np.uint8)


def main(
    captures: Path = Path("../shared/data"),
    names: tuple[str, ...] = ("llff_flower", "mipnerf360_bonsai"),
    out: Path = Path("results/bench"),
    seeds: int = 2,
    rainy: Path | None = None,
    clean: Path | None = None,
) -> None:
    """Draw panes and measure them, or measure one pair of pictures.

    Args:
        captures: folder of captures.
        names: captures in it.
        out: folder of the table and the picture.
        seeds: how many draws of every pattern.
        rainy: a picture in rain, to be measured instead.
        clean: the same without rain.
    """
    if (rainy is None) != (clean is None):
        raise InputError("one picture of a pair", expected="both --rainy and --clean, or neither")
    if rainy is not None and clean is not None:
        width = cv2.imread(str(clean)).shape[1] if clean.is_file() else 0
        print(pd.Series(measure(read_image(rainy), read_image(clean)) | {"width": width}).to_string())
        return
    rows: list[dict[str, Any]] = []
    pictures: list[list[Image]] = []
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        for name, seed in tqdm([(name, seed) for name in names for seed in range(seeds)], desc="panes", unit="scene"):
            drawn = panes(captures / name, seed, Path(scratch) / f"{name}-{seed}")
            pictures.append([rain for _, rain, _ in drawn])
            for grade, (kind, rain, scene) in zip(GRADES, drawn, strict=True):
                rows.append({"capture": name, "seed": seed, "grade": grade, "kind": kind} | measure(rain, scene))
    table = pd.DataFrame(rows)
    with replacing(out / "window_look.png") as temporary:
        temporary.write_bytes(cv2.imencode(".png", side_by_side(pictures))[1].tobytes())
    report(table, out / "window_look.csv")
