"""Quality against time: every method trained for the same seconds, on one scene and rain, one after another.

    python -m benchmarks methods --scene courtyard --pattern raindrop-1 --seconds 30 90 270

How many steps fit is told by a method's speed in its training before, so seconds are met roughly and reported as
measured. Schedules are stretched or cut with the steps. Nothing else should run on the machine.
Finished trainings are kept, an interrupted one goes on where it stopped. Writes methods.csv and curves.html.
"""

import time
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import plotly.graph_objects as go

from baselines.method import Method, find_method
from baselines.splatting.config import TrainerConfig
from baselines.splatting_profiles import with_iterations
from baselines.volumetric.config import VolumetricConfig
from benchmarks.quality import held_out, slug
from benchmarks.tables import report
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.files.atomic import read_json, write_bytes, write_json
from hydroviews.profiles import find_profile
from hydroviews.scene.scenes import Scene
from leaderboard.runs.train_and_render import only_training

METHODS = ("3dgs-clean", "3dgs", "nerf-w", "derain-nerf", "wild-gaussians", "gs-w", "deraings", "deraings-plus")
PROBE = 100  # steps that tell a method's speed at first
SPEED = "speed.json"  # of the training before; a training that is taken up again keeps to it


@dataclass(frozen=True)
class Course:
    """What all methods are given."""

    rainy: Scene
    clean: Scene
    profile: str
    seed: int
    folder: Path

    def train(self, name: str, steps: int, config: Any, folder: Path) -> tuple[Method, dict[str, Any]]:
        """A method trained in `folder`, and what that took: a row without scores."""
        method = find_method(name)(config, self.seed)
        scene = self.clean if method.trains_on == "clean" else self.rainy
        started = time.monotonic()
        method.fit(only_training(scene), folder)
        took = {"train s": round(method.summary().train_seconds, 3), "fit s": round(time.monotonic() - started, 3)}
        return method, {"method": name, "steps": steps, **took}

    def row(self, name: str, seconds: float, speed: float) -> dict[str, Any]:
        """A method's row for so many seconds at so many steps a second, or at those of the training taken up."""
        folder = self.folder / slug(name) / f"{seconds:g}s"
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / SPEED).is_file():
            write_json(folder / SPEED, {"steps a second": speed})
        steps = max(PROBE, round(seconds * read_json(folder / SPEED)["steps a second"]))
        method, row = self.train(name, steps, in_steps(self.settings(name), steps), folder)
        return {**row, "asked s": seconds, **held_out(method, self.clean)}

    def settings(self, name: str) -> Any:
        """A method's own for the profile."""
        return find_method(name).configuration(self.profile)

    def probe(self, name: str) -> float:
        """Steps a second in a first short training."""
        config = find_method(name).with_max_iterations(self.settings(name), PROBE)
        _, row = self.train(name, PROBE, config, self.folder / slug(name) / "probe")
        return speed_of(row)


def in_steps(settings: Any, steps: int) -> Any:
    """The same settings for so many training steps, with what they count in steps stretched or cut alike."""
    if isinstance(settings, TrainerConfig):
        start = round(settings.strategy.start * min(1, steps / settings.iterations))
        return with_iterations(steps, replace(settings, strategy=replace(settings.strategy, start=start)))
    if isinstance(settings, VolumetricConfig):
        share = steps / settings.iterations
        counted = {name: round(share * getattr(settings, name)) for name in ("warm_up", "anneal")}
        return replace(settings, iterations=steps, **counted)
    if not is_dataclass(settings) or isinstance(settings, type):
        return settings
    return replace(settings, **{part.name: in_steps(getattr(settings, part.name), steps) for part in fields(settings)})


def speed_of(row: dict[str, Any]) -> float:
    """Steps a second of a training."""
    return float(row["steps"]) / float(row["train s"])


def curves(table: pd.DataFrame) -> str:
    """An HTML page: held-out PSNR over seconds of training, a line a method."""
    figure = go.Figure()
    for name, rows in table.sort_values("train s").groupby("method", sort=False):
        figure.add_trace(go.Scatter(x=rows["train s"], y=rows["PSNR"], name=str(name), mode="lines+markers"))
    figure.update_xaxes(type="log", title_text="seconds of training").update_yaxes(title_text="held-out PSNR, dB")
    figure.update_layout(template="plotly_white", width=900, height=520)
    return str(figure.to_html(include_plotlyjs=True, full_html=True))


def main(
    scene: str = "courtyard",
    pattern: str = "raindrop-1",
    profile: str = "demo",
    seconds: tuple[float, ...] = (30, 90, 270),
    methods: tuple[str, ...] = METHODS,
    data: Path = Path("data"),
    out: Path = Path("results/bench/methods"),
    seed: int = 0,
) -> None:
    """Train all methods and report.

    Args:
        scene: an embedded scene, a capture's name or its folder.
        pattern: the rain, such as streak-1.
        profile: demo or standard; the size of the views, and each method's settings but for the steps.
        seconds: of training.
        methods: names, or `package.module:Class`.
        data: where the built scene lies or goes.
        out: gets a folder for every scene, pattern, profile and seed.
        seed: of the trainings.
    """
    built = build_source(scene, data / profile, find_profile(profile), patterns=(pattern,), all_patterns=False)
    folder = out / f"{built.name}-{pattern}-{profile}-{seed}"
    course = Course(open_variant(built, pattern), open_clean(built), profile, seed, folder)
    csv = folder / "methods.csv"
    rows: list[dict[str, Any]] = pd.read_csv(csv).to_dict("records") if csv.is_file() else []
    for name in methods:
        for budget in sorted(seconds):
            done = [row for row in rows if row["method"] == name and row["asked s"] <= budget]
            if any(row["asked s"] == budget for row in done):
                continue
            print(f"{name}, {budget:g} s:")
            speed = speed_of(max(done, key=lambda row: row["asked s"])) if done else course.probe(name)
            rows.append(course.row(name, budget, speed))
            table = pd.DataFrame(rows)
            report(table, csv)
            write_bytes(folder / "curves.html", curves(table).encode())
