"""What the resolution of occlusion masks buys: held-out quality, what masks cover, and the time of an iteration.

    python -m benchmarks.masking --scene courtyard --pattern raindrop-1

Trains plain 3DGS and `deraings.method:Masks` with networks that work at an eighth, a quarter and half the pictures'
resolution, one after another; prints a table and writes masking.csv. An interrupted run goes on where it stopped.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting_profiles import PROFILES
from benchmarks.ground_truth import in_and_between_drops, true_covers
from benchmarks.quality import held_out, slug
from deraings.masks.config import MaskConfig
from deraings.method import DeRainGSConfig, Masks
from hydroviews.cli.commands import run_command
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.profiles import find_profile
from hydroviews.scene.scenes import Scene

SHRINKS = (8, 4, 2)  # the default's is 4


def cases(profile: str, seed: int) -> Iterator[tuple[str, GaussianSplatting]]:
    """Names and untrained methods."""
    splatting = PROFILES[profile]
    yield "no masks", GaussianSplatting(splatting, seed)
    for shrink in SHRINKS:
        config = DeRainGSConfig(splatting, masks=replace(MaskConfig(), shrink=shrink))
        yield f"1/{shrink}", Masks(config, seed)


def covered(method: Masks, variant: Path, scene: Scene) -> dict[str, float]:
    """Means of the masks in drops and elsewhere."""
    masks = method.learned().masks
    assert masks is not None
    return in_and_between_drops(
        (masks.mask(index, (view.camera.height, view.camera.width)), true_covers(variant, view)["drops"])
        for index, view in enumerate(scene.train_views)
    )


def main(
    scene: str = "courtyard",
    pattern: str = "raindrop-1",
    profile: str = "demo",
    data: Path = Path("data"),
    out: Path = Path("results/bench/masking"),
    seed: int = 0,
) -> None:
    """Train all cases and report.

    Args:
        scene: an embedded scene, a capture's name or its folder.
        pattern: of drops on the lens.
        profile: demo or quick.
        data: where the built scene lies or goes.
        out: gets a folder for every scene, profile and seed, with masking.csv.
        seed: of the training.
    """
    built = build_source(scene, data / profile, find_profile(profile), patterns=(pattern,), all_patterns=False)
    rainy, clean = open_variant(built, pattern), open_clean(built)
    if "drops" not in true_covers(built / pattern, rainy.views[0]):
        raise InputError(f"--pattern {pattern}: no water on the lens", expected="a pattern of drops on the lens")
    folder = out / f"{built.name}-{profile}-{seed}"
    rows: list[dict[str, Any]] = []
    for name, method in cases(profile, seed):
        print(f"{name}:")
        method.fit(rainy, folder / slug(name))
        milliseconds = 1000 * method.summary().train_seconds / method.splatting.iterations
        row = {"masks at": name, **held_out(method, clean), "ms an iteration": round(milliseconds, 1)}
        rows.append(row | (covered(method, built / pattern, rainy) if isinstance(method, Masks) else {}))
        write_bytes(folder / "masking.csv", pd.DataFrame(rows).to_csv(index=False).encode())
    print(f"\n{pd.DataFrame(rows).to_string(index=False)}")


if __name__ == "__main__":
    run_command(main, prog="benchmarks.masking")
