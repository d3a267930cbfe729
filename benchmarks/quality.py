"""What each choice of training buys: quality on held-out clean views against Gaussians, file size and time.

    python -m benchmarks quality --scene PATH --profile standard

Trains plain 3DGS on the clean views once for every case, one after another; prints a table and writes quality.csv.
Finished cases are kept, an interrupted one goes on where it stopped.
"""

import logging
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import Method
from baselines.splatting.config import EarlyStop, Pruning, TrainerConfig
from baselines.splatting.files.ply import SPLATS
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.splatting_profiles import PROFILES, pruned_to_budget
from benchmarks.tables import finished, report
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean
from hydroviews.metrics import find_metrics
from hydroviews.profiles import find_profile
from hydroviews.scene.scenes import Scene
from leaderboard.scoring.score import score_image

logger = logging.getLogger(__name__)


def cases(profile: TrainerConfig) -> Iterator[tuple[str, TrainerConfig]]:
    """Names and configurations, most telling first: each changes one thing of the profile."""
    growth = profile.strategy
    assert isinstance(growth, DefaultStrategy)
    half = growth.budget // 2
    yield "profile", profile
    yield f"densification, {half} Gaussians", replace(profile, strategy=replace(growth, budget=half))
    yield f"pruned to {half} Gaussians, twice the iterations", pruned_to_budget(half, profile)
    yield f"pruned to {half // 2} Gaussians, twice the iterations", pruned_to_budget(half // 2, profile)
    relocation = MCMCStrategy(start=growth.start, stop=growth.stop, every=growth.every, budget=half)
    yield f"relocation, {half} Gaussians", replace(profile, strategy=relocation)
    weaker = replace(relocation, growth=0.15, noise=5e3, opacity_penalty=1e-3, scale_penalty=1e-3, spread=0.7)
    yield f"relocation with weaker noise and penalties, {half} Gaussians", replace(profile, strategy=weaker)
    for share in (0.3, 0.5):
        pruned = replace(profile, pruning=Pruning(at=(0.75,), share=share))
        yield f"{share:.0%} pruned by contribution", pruned
    for degree in range(profile.sh_degree):
        yield f"spherical harmonics to degree {degree}", replace(profile, sh_degree=degree)
    yield "full size from the start", replace(profile, resolutions=())
    yield "anti-aliased", replace(profile, antialiased=True)
    yield "early stop", replace(profile, early_stop=EarlyStop(every=max(1, profile.iterations // 24)))


def measure(config: TrainerConfig, scene: Scene, seed: int, folder: Path) -> dict[str, Any]:
    """Train, and score all held-out views: a row of the table."""
    method = GaussianSplatting(config, seed)
    method.fit(scene, folder)
    method.save(folder)
    statistics = method.summary()
    return {
        **held_out(method, scene),
        "Gaussians": statistics.n_primitives,
        "ply MB": round((folder / SPLATS).stat().st_size / 1e6, 2),
        "train s": round(statistics.train_seconds),
    }


def slug(name: str) -> str:
    """A case's name as one of a folder."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower())


def held_out(method: Method, scene: Scene) -> dict[str, float]:
    """All metrics of a trained method, means over the held-out views of the clean scene; NaN where one has no score."""
    reasons: dict[str, str] = {}
    views = tqdm(scene.test_views, desc="held-out views", unit="view", leave=False)
    scores = pd.DataFrame([score_image(method.render(view.camera), view, reasons) for view in views]).astype(float)
    for name, reason in reasons.items():
        logger.warning("%s: %s", name, reason)
    return {
        metric.title: round(float(scores[metric.name].mean(skipna=False)), metric.decimals) for metric in find_metrics()
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
        profile: demo or standard.
        only: train the cases whose names begin with one of these.
        data: where the built scene lies or goes.
        out: gets a folder for every scene, profile and seed, with quality.csv.
        seed: of the training.
    """
    built = build_source(scene, data / profile, find_profile(profile), patterns=(), all_patterns=False)
    clean = open_clean(built)
    folder = out / f"{built.name}-{profile}-{seed}"
    chosen = [case for case in cases(PROFILES[profile]) if not only or case[0].startswith(only)]
    steps = [({"case": name}, partial(measure, config, clean, seed, folder / slug(name))) for name, config in chosen]
    csv = folder / "quality.csv"
    report(finished(csv, steps), csv)
