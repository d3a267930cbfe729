"""What each choice of training buys: quality on held-out clean views against Gaussians, file size and time.

    python -m benchmarks.quality --scene PATH --profile quick

Trains plain 3DGS on the clean views once for every case, one after another; prints a table and writes quality.csv.
Finished cases are kept, an interrupted one goes on where it stopped.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tyro
from tqdm import tqdm

from baselines.gaussian_splatting import PROFILES
from baselines.splatting.config import EarlyStop, Pruning, TrainerConfig
from baselines.splatting.densification import Densification
from baselines.splatting.ply import write_ply
from baselines.splatting.rasterizer import Workspace, render
from baselines.splatting.relocation import Relocation
from baselines.splatting.trainer import Trained, train
from hydroviews.files import write_bytes
from hydroviews.metrics import psnr, ssim
from hydroviews.profiles import find_profile
from hydroviews.scenes import Scene
from hydroviews.sources import build_source
from hydroviews.variants import open_clean


def cases(profile: TrainerConfig) -> Iterator[tuple[str, TrainerConfig]]:
    """Names and configurations, most telling first: each changes one thing of the profile."""
    growth = profile.densification
    assert isinstance(growth, Densification)
    relocation = Relocation(start=growth.start, stop=growth.stop, every=growth.every, budget=growth.budget)
    yield "profile", profile
    for share in (1, 2, 4):
        budget = growth.budget // share
        if share > 1:
            yield f"densification, {budget} Gaussians", replace(profile, densification=replace(growth, budget=budget))
        yield f"relocation, {budget} Gaussians", replace(profile, densification=replace(relocation, budget=budget))
    for share in (0.3, 0.5):
        pruned = replace(profile, pruning=Pruning(at=(0.75,), share=share))
        yield f"{share:.0%} pruned by contribution", pruned
    for degree in range(profile.sh_degree):
        yield f"spherical harmonics to degree {degree}", replace(profile, sh_degree=degree)
    yield "half the size for a third of the time", replace(profile, resolutions=((0.33, 2),))
    yield "anti-aliased", replace(profile, antialiased=True)
    yield "early stop", replace(profile, early_stop=EarlyStop(every=max(1, profile.iterations // 24)))


def measure(name: str, trained: Trained, scene: Scene, config: TrainerConfig, folder: Path) -> dict[str, Any]:
    """A row of the table."""
    workspace, background = Workspace(), np.asarray(config.background, np.float32)
    scores = []
    for view in tqdm(scene.test_views, desc="held-out views", unit="view", leave=False):
        image, _ = render(
            trained.gaussians, view.camera, background, near=trained.near, antialiased=config.antialiased,
            workspace=workspace,
        )  # fmt: skip
        shown, truth = np.clip(image, 0, 1), view.image()
        scores.append((psnr(shown, truth), ssim(shown, truth)))
    write_ply(folder / "splats.ply", trained.gaussians)
    return {
        "case": name,
        "PSNR": round(float(np.mean([p for p, _ in scores])), 2),
        "SSIM": round(float(np.mean([s for _, s in scores])), 4),
        "Gaussians": len(trained.gaussians),
        "ply MB": round((folder / "splats.ply").stat().st_size / 1e6, 2),
        "iterations": trained.iterations,
        "train s": round(trained.seconds),
    }


def main(
    scene: str = "courtyard",
    profile: str = "demo",
    only: tuple[str, ...] = (),
    data: Path = Path("data"),
    out: Path = Path("results/bench/quality"),
    seed: int = 0,
) -> None:
    """Train all cases and report.

    Args:
        scene: an embedded scene, a capture's name or its folder.
        profile: demo or quick.
        only: train the cases whose names begin with one of these.
        data: where the built scene lies or goes.
        out: gets a folder for every scene, profile and seed, with quality.csv.
        seed: of the training.
    """
    built = build_source(scene, data / profile, find_profile(profile), patterns=(), all_patterns=False)
    clean = open_clean(built)
    folder = out / f"{built.name}-{profile}-{seed}"
    table = folder / "quality.csv"
    rows = pd.read_csv(table).to_dict("records") if table.is_file() else []
    chosen = [case for case in cases(PROFILES[profile]) if not only or case[0].startswith(only)]
    for name, config in chosen:
        if any(row["case"] == name for row in rows):
            continue
        print(f"{name}:")
        place = folder / name.replace(" ", "-").replace(",", "").replace("%", "")
        trained = train(clean, config, seed, place)
        rows.append(measure(name, trained, clean, config, place))
        write_bytes(table, pd.DataFrame(rows).to_csv(index=False).encode())
    print(f"\n{pd.DataFrame(rows).to_string(index=False)}")


if __name__ == "__main__":
    tyro.cli(main)
