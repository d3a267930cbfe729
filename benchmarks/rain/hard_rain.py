"""Hard cases: photographs on which a method could find rain that is not there, or too much of it at once.

    python -m benchmarks hard_rain --scene courtyard --methods 3dgs deraings-plus

Clean views, real fog, the worst grades, drops and streaks together, a photograph that shows mist alone, a third of the
views. Trains every method on every case, one after another; prints a table and writes hard_rain.csv.
Finished trainings are kept, an interrupted one goes on where it stopped.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from baselines.method import find_method
from benchmarks.quality import held_out, slug
from benchmarks.tables import finished, report
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.files.atomic import read_json
from hydroviews.profiles import find_profile
from hydroviews.rain.compositing import Layers
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect
from hydroviews.scene.depth import view_depth
from hydroviews.scene.images import Image, to_linear, to_srgb, write_png
from hydroviews.scene.scenes import Scene, View
from leaderboard.runs.train_and_render import only_training

PATTERNS = ("raindrop-1", "raindrop-2", "streak-1", "streak-2")
AIR = 0.75  # encoded grey of fog and of the photograph that shows mist alone
Pair = tuple[Scene, Scene]  # photographs, and the scene whose held-out views are the truth


def cases(built: Path, made: Path) -> dict[str, Callable[[], Pair]]:
    """What opens the photographs of every case of a built scene, by its name; `made` gets those that are painted."""
    clean = open_clean(built)
    drops, streaks = open_variant(built, "raindrop-1"), open_variant(built, "streak-1")

    def in_fog() -> Pair:
        fog = painted(clean, made / "fog", foggy(clean))
        return fog, fog

    return {
        "clean": lambda: (clean, clean),
        "fog in the scene": in_fog,
        "raindrop-2": lambda: (open_variant(built, "raindrop-2"), clean),
        "streak-2": lambda: (open_variant(built, "streak-2"), clean),
        "raindrop-1 before streak-1": lambda: (painted(streaks, made / "both", behind(built / "raindrop-1")), clean),
        "raindrop-1, one photograph all mist": lambda: (painted(drops, made / "mist", blank(drops)), clean),
        "clean, a third of the views": lambda: (clean.sparse(), clean),
        "raindrop-1, a third of the views": lambda: (drops.sparse(), clean),
        "streak-1, a third of the views": lambda: (streaks.sparse(), clean),
    }


def painted(scene: Scene, folder: Path, paint: Callable[[View], Image]) -> Scene:
    """The scene with other photographs, which are kept in `folder`."""
    views = []
    for view in tqdm(scene.views, desc=folder.name, unit="view", leave=False):
        path = folder / "images" / f"{view.name}.png"
        if not path.is_file():
            write_png(path, paint(view))
        views.append(replace(view, path=path))
    return replace(scene, views=tuple(views))


def foggy(scene: Scene) -> Callable[[View], Image]:
    """Fog that takes half of the light of what is at the scene's middle depth, all of the sky's."""
    depths = {view.name: view_depth(view, scene.points, view.image()) for view in scene.views}
    middle = np.median(np.concatenate([depth[np.isfinite(depth)] for depth in depths.values()]))
    air = to_linear(np.full(3, AIR, np.float32))

    def paint(view: View) -> Image:
        passing = np.exp2(-depths[view.name] / middle)[..., None]
        return to_srgb(to_linear(view.image()) * passing + air * (1 - passing))

    return paint


def behind(variant: Path, part: Callable[[Layers], Layers] = lambda layers: layers) -> Callable[[View], Image]:
    """Photographs as they are through the wet lens of a variant, or through a part of its layers."""
    pattern = read_json(variant / PATTERN_FILE)

    def paint(view: View) -> Image:
        layers = part(layers_of(variant, view))
        return find_effect(pattern["effect"]).composite(pattern["parameters"], view.image(), layers)

    return paint


def layers_of(variant: Path, view: View) -> Layers:
    """The layers of a view of a variant."""
    return read_layers(variant / "layers" / f"{view.name}.exr")


def blank(scene: Scene) -> Callable[[View], Image]:
    """Photographs as they are, but for one in the middle of the training views that shows nothing but mist."""
    lost = scene.split.train[len(scene.split.train) // 2]

    def paint(view: View) -> Image:
        return np.full_like(view.image(), AIR) if view.name == lost else view.image()

    return paint


def row(name: str, pair: Pair, profile: str, seed: int, folder: Path) -> dict[str, Any]:
    """Train one method on photographs, in a folder of its own in `folder`, and score the held-out views."""
    photographs, truth = pair
    kind = find_method(name)
    method = kind(kind.configuration(profile), seed)
    method.fit(only_training(photographs), folder / slug(name))
    return {**held_out(method, truth), "used": method.summary().used}


def _train(opened: Callable[[], Pair], name: str, *settings: Any) -> dict[str, Any]:
    """The row of a case that is opened only now."""
    return row(name, opened(), *settings)


def train_all(
    cases: Mapping[str, Callable[[], Pair]], methods: Sequence[str], profile: str, seed: int, folder: Path, csv: Path
) -> pd.DataFrame:
    """A row for every case and method; those that `csv` has are kept, and trainings in `folder` go on."""
    trainings = []
    for case, opened in cases.items():
        for name in methods:
            train = partial(_train, opened, name, profile, seed, folder / slug(case))
            trainings.append(({"photographs": case, "method": name}, train))
    return finished(csv, trainings)


def main(
    scene: str = "courtyard",
    profile: str = "demo",
    methods: tuple[str, ...] = ("3dgs", "deraings", "deraings-plus"),
    only: tuple[str, ...] = (),
    data: Path = Path("data"),
    out: Path = Path("results/bench/hard_rain"),
    seed: int = 0,
) -> None:
    """Train all cases and report.

    Args:
        scene: an embedded scene, a capture's name or its folder.
        profile: demo or standard.
        methods: names, or `package.module:Class`; not those that see clean views.
        only: train the cases whose names begin with one of these.
        data: where the built scene lies or goes.
        out: gets a folder for every scene, profile and seed, with hard_rain.csv.
        seed: of the trainings.
    """
    built = build_source(scene, data / profile, find_profile(profile), patterns=PATTERNS, all_patterns=False)
    folder = out / f"{built.name}-{profile}-{seed}"
    chosen = {name: case for name, case in cases(built, folder).items() if not only or name.startswith(only)}
    csv = folder / "hard_rain.csv"
    report(train_all(chosen, methods, profile, seed, folder, csv), csv)
