"""Finished runs made in no time, with and without Gaussians."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from synthetic import capture_in

from baselines.method import Method, TrainingSummary
from baselines.splatting.files.ply import SPLATS, read_ply, write_ply
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.rasterizer import render
from hydroviews.dataset.sources import build_source
from hydroviews.files.atomic import write_bytes, write_json
from hydroviews.formats.writers import write_colmap
from hydroviews.profiles import find_profile
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Points, Scene
from leaderboard.runs.run import Run, claim_folder
from leaderboard.runs.train_and_render import train_and_render


@dataclass(frozen=True)
class Settings:
    n_gaussians: int = 300


class Cloud(Method):
    """Puts random Gaussians where the scene is."""

    gaussians: Gaussians

    @classmethod
    def configuration(cls, profile: str) -> Settings:
        return Settings()

    def fit(self, scene: Scene, folder: Path) -> None:
        rng, n = np.random.default_rng(self.seed), self.config.n_gaussians
        self.gaussians = Gaussians(
            means=rng.uniform(-1, 1, (n, 3)).astype(np.float32),
            quaternions=rng.normal(size=(n, 4)).astype(np.float32),
            log_scales=np.full((n, 3), np.log(0.1), np.float32),
            opacity_logits=rng.normal(1, 1, n).astype(np.float32),
            sh=rng.normal(0, 0.4, (n, 4, 3)).astype(np.float32),
            origin=scene.points.positions.mean(axis=0),
        )

    def render(self, camera: Camera) -> Image:
        return np.clip(render(self.gaussians, camera)[0], 0, 1)

    def save(self, folder: Path) -> None:
        write_ply(folder / SPLATS, self.gaussians)

    @classmethod
    def load(cls, config: Settings, seed: int, folder: Path) -> Self:
        method = cls(config, seed)
        method.gaussians = read_ply(folder / SPLATS)
        return method

    def summary(self) -> TrainingSummary:
        return TrainingSummary(0.1, len(self.gaussians), 0.1, "cpu")


class Grey(Cloud):
    """Has no Gaussians."""

    def fit(self, scene: Scene, folder: Path) -> None:
        pass

    def render(self, camera: Camera) -> Image:
        return np.full((camera.height, camera.width, 3), 0.5, np.float32)

    def save(self, folder: Path) -> None:
        pass

    @classmethod
    def load(cls, config: Settings, seed: int, folder: Path) -> Self:
        return cls(config, seed)

    def summary(self) -> TrainingSummary:
        return TrainingSummary(0.1, None, None, "cpu")


def finished_run(folder: Path, method: str = "Cloud", shift: float = 0.0, rainy: bool = False) -> Run:
    """Build a capture whose origin lies `shift` from zero, captured in rain or streaked, and run a method on it."""
    capture = folder / "yard"
    scene = shifted(capture_in(capture), shift)
    write_colmap(scene, capture / "sparse" / "0")
    if rainy:
        write_json(capture / "capture.json", {"rain": "captured"})
    pattern = "captured-0" if rainy else "streak-0"
    patterns = () if rainy else (pattern,)
    build_source(str(capture), folder / "data/demo", find_profile("demo"), patterns=patterns, all_patterns=rainy)
    run = Run(f"finished_runs:{method}", "demo", 0, folder / "data/demo", "yard", pattern, folder / "results")
    claim_folder(run, overwrite=False)
    train_and_render(run)
    write_bytes(folder / "results/leaderboard.csv", b"")
    return run


def shifted(scene: Scene, shift: float) -> Scene:
    views = []
    for view in scene.views:
        pose = view.camera.world_to_camera.copy()
        pose[:3, 3] -= pose[:3, :3] @ np.full(3, shift)
        views.append(replace(view, camera=replace(view.camera, world_to_camera=pose)))
    points = Points(scene.points.positions + shift, scene.points.colours)
    return replace(scene, views=tuple(views), points=points)
