"""Renewed drops and drops in focus: what a view costs, and how far short cuts are from what they stand for.

    python -m benchmarks renewed_drops --out results/bench

Prints three tables and writes them as renewed_drops-*.csv:

* cost: CPU milliseconds that the layers and the composite of a view take, by effect and size; bakes are not counted;
* shift: PSNR, in encoded values and in pixels at least half under water, of the drops of a bank's lens moved by a share
  of the picture, against the same drops baked at that place; "unmoved paths" leaves the light paths where they were;
* focus: PSNR, in the same pixels, of drops in focus and the blurred scene around them, against path tracing.
"""

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from benchmarks.rain.raindrops import GRADES, noise, pictures
from benchmarks.tables import report
from hydroviews.rain.compositing import water_over
from hydroviews.rain.effect import fall
from hydroviews.rain.lens.effect import RaindropEffect, SharpRaindropEffect
from hydroviews.rain.lens.optics.bake import aperture_radius, bake_matte, focus_disk, lens_water, trace
from hydroviews.rain.lens.optics.drop_bank import DropPainter
from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.lens.patterns.pattern import MEDIUM, RaindropPattern, draw_pattern
from hydroviews.rain.lens.raindrops import PreparedLens
from hydroviews.rain.lens.renewed import BankLens
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear, to_srgb
from hydroviews.scene.scenes import View

SIZES = ((320, 240), (400, 300))
VIEWS, REPEATS = 40, 3
KINDS: dict[str, dict[str, Any]] = {
    "fixed window": {},
    "renewed 0.1": {"renewed": 0.1},
    "renewed 0.5": {"renewed": 0.5},
    "renewed 1": {"renewed": 1.0},
    "drops in focus": {"focus": "drops"},
}
SHIFTS = (0.025, 0.05, 0.1, 0.2)
SIZE = (200, 150)  # of what is compared with tracing and baking


def camera(width: int, height: int) -> Camera:
    """One of 64 degrees across."""
    return Camera(width, height, 0.8 * width, 0.8 * width, width / 2, height / 2, np.eye(4))


def cost(size: tuple[int, int], folder: Path) -> list[dict[str, Any]]:
    """A row a kind of lens: the median over views, kinds in turn so that all meet the same machine."""
    lens, clean = camera(*size), noise(*size)
    names = [f"{i:03d}" for i in range(VIEWS)]
    drawn = {kind: replace(draw_pattern(np.random.default_rng(1), MEDIUM), **said) for kind, said in KINDS.items()}
    air = np.full(3, 0.6, np.float32)
    ready = {kind: PreparedLens(p, air, names, lens, folder / kind) for kind, p in drawn.items()}
    spent: dict[str, list[tuple[float, float]]] = {kind: [] for kind in KINDS}
    for turn in range(REPEATS + 1):  # the first bakes
        for name in names:
            view = View(name, lens, folder / "none.png")
            for kind, pattern in drawn.items():
                effect = SharpRaindropEffect() if pattern.focus == "drops" else RaindropEffect()
                start = time.process_time()
                layers = fall(ready[kind], clean, view)
                middle = time.process_time()
                effect.composite({"focus": pattern.focus, "focus_blur": pattern.focus_blur}, clean, layers)
                if turn:
                    spent[kind].append((middle - start, time.process_time() - middle))
    rows = []
    for kind, times in spent.items():
        drawing, compositing = 1e3 * np.median(times, axis=0)
        rows.append({"size": f"{size[0]}x{size[1]}", "kind": kind, "layers_ms": drawing, "composite_ms": compositing})
    whole = rows[0]["layers_ms"] + rows[0]["composite_ms"]
    return [{**row, "times": (row["layers_ms"] + row["composite_ms"]) / whole} for row in rows]


def shift_errors(pattern: RaindropPattern, picture: Image, folder: Path) -> list[dict[str, Any]]:
    """A row a shift, to the right and down by the same share of width and height."""
    lens, light = camera(*SIZE), to_linear(picture)
    bank = BankLens.of(pattern, lens, 0)
    here = bank.baked(0, pattern, lens, folder / "here.npz")
    everything = np.arange(len(here.starts) - 1)
    rows = []
    for share in SHIFTS:
        right, down = (round(share * side) for side in SIZE)
        # As seen by a camera whose axis is as far to the left and above, drops sit where they are to be moved to.
        canvas = replace(bank.canvas, cx=bank.canvas.cx - right, cy=bank.canvas.cy - down)
        there = replace(bank, canvas=canvas).baked(0, pattern, lens, folder / f"there-{share}.npz")
        expected, found, unmoved = (DropPainter(light) for _ in range(3))
        expected.paint(there, everything, (right, down))
        found.paint(here, everything, (right, down))
        unmoved.paint(
            replace(here, ends=here.ends - np.array([right, down], here.ends.dtype)), everything, (right, down)
        )
        inside = expected.mask > 0.5
        rows.append({
            "shift": share,
            "psnr": _psnr(found.radiance, expected.radiance, inside),
            "unmoved paths": _psnr(unmoved.radiance, expected.radiance, inside),
            "cover differs": float(np.abs(found.mask - expected.mask).mean() / expected.mask.mean()),
        })  # fmt: skip
    return rows


def focus_errors(pattern: RaindropPattern, picture: Image, folder: Path, samples: int) -> list[dict[str, Any]]:
    """A row a lens renderer, for drops in focus."""
    lens, light = camera(*SIZE), to_linear(picture)
    disk = focus_disk(pattern, lens)
    opening, mesh = aperture_radius(disk, lens), lens_water(pattern, lens, 0)
    traced, fewer = (
        trace(mesh, lens, light, n, folder, opening, seed=n, focus="drops")[0] for n in (samples, samples // 4)
    )
    seen, inside = defocus(light, disk), traced[..., 3] > 0.5
    expected = _over(seen, traced[..., 3], traced[..., :3])
    rows = [("path tracing, a quarter of the samples", fewer[..., 3], fewer[..., :3])]
    for renderer in ("disk", "aperture"):
        matte = bake_matte(replace(pattern, lens_renderer=renderer), lens, folder / renderer)
        rows.append((renderer, matte.mask, matte.apply(seen if renderer == "disk" else light)))
    return [
        {"lens renderer": name, "psnr": _psnr(_over(seen, mask, drops), expected, inside)} for name, mask, drops in rows
    ]


def _over(seen: Image, mask: np.ndarray, drops: np.ndarray) -> Image:
    layers = {"M": mask, "V": np.zeros_like(mask), **{c: drops[..., i] for i, c in enumerate("RGB")}}
    return water_over(seen, layers)


def _psnr(one: Image, other: Image, inside: np.ndarray) -> float:
    error = (to_srgb(one) - to_srgb(other))[inside].astype(np.float64)
    return float(-10 * np.log10((error**2).mean()))


def main(out: Path = Path("results/bench"), reference_samples: int = 1024) -> None:
    """Measure and report.

    Args:
        out: folder of the tables.
        reference_samples: of the path tracing that drops in focus are compared with.
    """
    tables: dict[str, list[dict[str, Any]]] = {"cost": [], "shift": [], "focus": []}
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        for size in tqdm(SIZES, desc="cost", unit="size"):
            tables["cost"] += cost(size, Path(scratch) / f"cost-{size[0]}")
        for grade in tqdm(range(len(GRADES)), desc="error", unit="grade"):
            pattern = draw_pattern(np.random.default_rng(grade), grade)
            for name, picture in pictures(*SIZE):
                case, folder = {"grade": GRADES[grade], "background": name}, Path(scratch) / str(grade)
                tables["shift"] += [case | row for row in shift_errors(pattern, picture, folder)]
                sharp = replace(pattern, focus="drops")
                tables["focus"] += [case | row for row in focus_errors(sharp, picture, folder, reference_samples)]
    for name, rows in tables.items():
        report(pd.DataFrame(rows), out / f"renewed_drops-{name}.csv", name)
