"""What rain costs cameras that are estimated in it: registered views, areas under the curve, medians of errors.

    python -m benchmarks poses data/demo/courtyard --patterns clean raindrop-1 streak-1 --enhanced

Estimates cameras from a built scene's photographs, clean or in rain, and compares them with the scene's own; prints a
table and writes poses.csv. An interrupted run goes on where it stopped.
"""

import dataclasses
import itertools
from functools import partial
from pathlib import Path
from typing import Any

import tyro

from benchmarks.tables import finished, report
from benchmarks.timing import counted, counted_seconds
from deraings.enhancement.enhance import enhance
from hydroviews.captures.sfm.mapping import TooFewRegistered
from hydroviews.captures.sfm.poses import FeatureKind, estimate_poses
from hydroviews.captures.sfm.rain import Enhance
from hydroviews.captures.sfm.sources import link_photographs
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.scene.camera_errors import compare_cameras
from hydroviews.scene.scenes import View

CSV = "poses.csv"
SPENT = "cpu-seconds.txt"
CAMERA_MODEL = "SIMPLE_PINHOLE"  # what built pictures are: undistorted, about their middle


def linked(views: tuple[View, ...], folder: Path) -> dict[str, View]:
    """Link the views' photographs into a folder, under names that tell their order alone; the views by these names."""
    named = {f"{i:05d}": view for i, view in enumerate(views)}
    link_photographs({f"{name}.png": view.path for name, view in named.items()}, folder, turned=False)
    return named


def measure(
    views: tuple[View, ...],
    rainy: bool,
    folder: Path,
    seed: int,
    enhance: Enhance | None = None,
    features: FeatureKind = "auto",
) -> dict[str, Any]:
    """Errors of the cameras estimated from views, against their own; an interrupted estimation in `folder` goes on."""
    named = linked(views, folder / "photographs")
    true = {name: view.camera.world_to_camera for name, view in named.items()}
    try:
        with counted(folder / SPENT):
            scene = estimate_poses(
                folder / "photographs",
                folder / "capture",
                CAMERA_MODEL,
                seed=seed,
                rainy=rainy,
                enhance=enhance,
                features=features,
            )
        errors, _ = compare_cameras({view.name: view.camera.world_to_camera for view in scene.views}, true)
    except TooFewRegistered as error:
        errors = dataclasses.replace(compare_cameras({}, true)[0], registered=error.registered)
    return {**dataclasses.asdict(errors), "cpu_s": round(counted_seconds(folder / SPENT))}


def main(
    scenes: tyro.conf.Positional[tuple[Path, ...]],
    patterns: tuple[str, ...] = (CLEAN, "raindrop-1", "streak-1"),
    every: int = 1,
    out: Path = Path("results/bench/poses"),
    seed: int = 0,
    enhanced: bool = False,
    features: FeatureKind = "auto",
) -> None:
    """Measure all patterns of all scenes and report.

    Args:
        scenes: folders of built scenes.
        patterns: variants, or clean.
        every: take every so manieth view.
        out: gets a folder for every scene and pattern, with poses.csv, which keeps the rows of earlier calls.
        seed: of the estimation.
        enhanced: take features of pictures enhanced by the shipped network.
        features: see `estimate_poses`.
    """

    def errors(scene: Path, pattern: str, helped: bool, name: str) -> dict[str, Any]:
        built = open_clean(scene) if pattern == CLEAN else open_variant(scene, pattern)
        chosen = enhance if helped else None
        return measure(built.views[::every], pattern != CLEAN, out / name, seed, chosen, features)

    cases = []
    for scene, pattern in itertools.product(scenes, patterns):
        helped = enhanced and pattern != CLEAN
        name = f"{scene.resolve().name}-{pattern}-{every}-{seed}{'-enhanced' if helped else ''}-{features}"
        row = {"scene": scene.resolve().name, "pattern": pattern, "enhanced": helped, "features": features}
        row |= {"every": every, "seed": seed}
        cases.append((row, partial(errors, scene, pattern, helped, name)))
    report(finished(out / CSV, cases), out / CSV)
