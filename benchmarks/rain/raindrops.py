"""Drops on the lens: what mattes cost and how far they are from path tracing.

    python -m benchmarks raindrops --out results/bench

Prints a table and writes raindrops.csv. Every lens renderer shows the same drops with the same aperture in front of the
same picture; the PSNR, in encoded values, is over the pixels that are at least half under water, against path tracing
with `reference_samples` and another seed. Seconds are CPU seconds, of rendering or of applying a matte alone, without
starting Blender; "once" is the whole bake. Cases that are in the file already are kept.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.tables import finished, report
from benchmarks.timing import counted, counted_seconds
from hydroviews.rain.lens.optics.bake import aperture_radius, bake_matte, focus_disk, lens_water, trace
from hydroviews.rain.lens.optics.path_matte import PathMatte
from hydroviews.rain.lens.patterns.pattern import RaindropPattern, draw_pattern
from hydroviews.rain.light import expand_highlights
from hydroviews.rain.scene_statistics import LensRenderer
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, read_image, to_linear, to_srgb

GRADES = ("light", "medium", "heavy")
SIZES = ((200, 150), (400, 300))
MATTES: tuple[tuple[LensRenderer, int | None], ...] = (("disk", 2), ("disk", None), ("disk", 8), ("aperture", None))
REPEATS = 7


def noise(width: int, height: int) -> Image:
    """A gradient with noise of all sizes, encoded; bright spots are saturated."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width] / max(width, height)
    picture = np.stack([0.3 + 0.5 * x, 0.5 - 0.3 * y, 0.6 - 0.4 * x + 0.3 * y], axis=-1)
    for octave in range(2, 8):
        coarse = rng.normal(0, 0.35 / octave, (2**octave, 2**octave, 3))
        picture += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(picture, 0, 1).astype(np.float32)


def photograph(width: int, height: int) -> Image | None:
    """A view of Mip-NeRF 360's bonsai, cut to shape; None where the capture is not at hand."""
    captures = Path(os.environ.get("HYDROVIEWS_CAPTURES", "../shared/data"))
    files = sorted((captures / "mipnerf360_bonsai" / "images").glob("*"))
    if not files:
        return None
    image = read_image(files[10])
    scale = max(width / image.shape[1], height / image.shape[0])
    size = [max(side, round(old * scale)) for side, old in zip((width, height), image.shape[1::-1], strict=True)]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)[:height, :width], np.float32)


def pictures(width: int, height: int) -> Iterator[tuple[str, Image]]:
    """The backgrounds by name."""
    yield "noise", noise(width, height)
    if (photo := photograph(width, height)) is not None:
        yield "bonsai", photo


def measure(pattern: RaindropPattern, picture: Image, folder: Path, reference: int) -> list[dict[str, Any]]:
    """A row for each lens renderer in front of one picture; mattes are kept in `folder`."""
    height, width = picture.shape[:2]
    camera = Camera(width, height, 0.8 * width, 0.8 * width, width / 2, height / 2, np.eye(4))
    clean = to_linear(picture)
    light = expand_highlights(clean)
    opening, mesh = aperture_radius(focus_disk(pattern, camera), camera), lens_water(pattern, camera, 0)
    truth, _ = trace(mesh, camera, light, reference, folder, opening, seed=1000)
    inside = truth[..., 3] > 0.5
    expected = _composite(clean, truth[..., 3], truth[..., :3])

    def row(lens_renderer: str, cover: NDArray, drops: NDArray, once: float, per_view: float) -> dict[str, Any]:
        error = _composite(clean, cover, drops)[inside] - expected[inside]
        psnr = -10 * np.log10((error.astype(np.float64) ** 2).mean())
        return {
            "lens_renderer": lens_renderer,
            "psnr": psnr,
            "once_s": once,
            "view_s": per_view,
            "inside": inside.mean(),
        }

    rows = []
    for samples in (16, 64, 384):
        traced, seconds = trace(mesh, camera, light, samples, folder, opening, seed=samples)
        rows.append(row(f"path tracing, {samples}", traced[..., 3], traced[..., :3], 0.0, seconds))
    for lens_renderer, paths in MATTES:
        name = lens_renderer if paths is None else f"{lens_renderer}, {paths}x{paths} paths"
        once, matte = _baked(replace(pattern, lens_renderer=lens_renderer), camera, folder / name, paths)
        rows.append(row(name, matte.mask, matte.apply(light), once, _cost(matte, light)))
    traced_64 = next(r["view_s"] for r in rows if r["lens_renderer"] == "path tracing, 64")
    return [{**r, "cheaper than 64": traced_64 / r["view_s"]} for r in rows]


def _composite(clean: Image, cover: NDArray, drops: NDArray) -> Image:
    return to_srgb((1 - cover[..., None]) * clean + drops)


def _baked(pattern: RaindropPattern, camera: Camera, folder: Path, paths: int | None) -> tuple[float, PathMatte]:
    """A matte and the CPU seconds that its bake took, also where it was baked for an earlier picture."""
    spent = folder / "seconds.txt"
    with counted(spent):
        matte = bake_matte(pattern, camera, folder, paths=paths)
    return counted_seconds(spent), matte


def _cost(matte: PathMatte, light: Image) -> float:
    turns = []
    for _ in range(REPEATS):
        start = time.process_time()
        matte.apply(light)
        turns.append(time.process_time() - start)
    return min(turns)


def main(out: Path = Path("results/bench"), reference_samples: int = 1024) -> None:
    """Measure and report.

    Args:
        out: folder of raindrops.csv.
        reference_samples: of the path tracing that all else is compared with.
    """
    file = out / "raindrops.csv"
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        cases: list[tuple[dict[str, Any], Callable[[], list[dict[str, Any]]]]] = []
        for (width, height), (index, grade) in product(SIZES, enumerate(GRADES)):
            size, pattern = f"{width}x{height}", draw_pattern(np.random.default_rng(index), index)
            for name, picture in pictures(width, height):
                case = {"size": size, "grade": grade, "background": name, "reference": reference_samples}
                folder = Path(scratch) / f"{size}-{grade}"
                cases.append((case, partial(measure, pattern, picture, folder, reference_samples)))
        table = finished(file, cases)
    report(table, file)
    columns = ["psnr", "once_s", "view_s", "cheaper than 64"]
    print("\nmeans\n" + table.groupby(["size", "lens_renderer"], sort=False)[columns].mean().round(4).to_string())
