"""The cost of the parts of a wet window, and the share that a method recovers: drops alone, mist alone, a true cover.

    python -m benchmarks windows --scene courtyard --pattern window-1 --methods 3dgs deraings-plus

The parts are painted from the layers of a built variant, so no drop is drawn again. "True cover" hides pixels that
drops cover by more than a half, as masks of a user would. Hidden clean views show what hiding costs. Prints a table
with the share of the gap to clean views, and writes windows.csv. Finished trainings are kept.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.rain.hard_rain import Pair, behind, layers_of, painted, train_all
from benchmarks.tables import report
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.files.atomic import read_json, sha256
from hydroviews.profiles import find_profile
from hydroviews.rain.compositing import Layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.scene.masks import write_ignored
from hydroviews.scene.scenes import Scene

COVERED = 0.5  # M, above which a pixel is hidden by the true cover
PLAIN = "3dgs"


def cases(built: Path, pattern: str, made: Path) -> dict[str, Callable[[], Pair]]:
    """Functions that open the photographs of every case of a built scene, by its name; `made` gets painted ones."""
    clean, variant = open_clean(built), built / pattern
    air = np.array(read_json(variant / PATTERN_FILE)["parameters"]["air_light"], np.float32)  # light [3] of the mist
    no_mist, no_drops = partial(without_mist, air=air), partial(without_drops, air=air)

    def drops() -> Scene:
        return painted(clean, made / "drops", behind(variant, no_mist))

    return {
        "clean": lambda: (clean, clean),
        pattern: lambda: (open_variant(built, pattern), clean),
        "drops alone": lambda: (drops(), clean),
        "mist alone": lambda: (painted(clean, made / "mist", behind(variant, no_drops)), clean),
        "clean, true cover hidden": lambda: (masked(clean, variant, made / "masks"), clean),
        "drops alone, true cover hidden": lambda: (masked(drops(), variant, made / "masks"), clean),
    }


def without_mist(layers: Layers, air: np.ndarray) -> Layers:
    """The drops of a window."""
    veil = (1 - layers["M"]) * layers["V"]
    light = {c: layers[c] - veil * air[i] for i, c in enumerate("RGB")}
    return {"M": layers["M"], "V": np.zeros_like(veil), **light}


def without_drops(layers: Layers, air: np.ndarray) -> Layers:
    """The mist of a window."""
    light = {c: layers["V"] * air[i] for i, c in enumerate("RGB")}
    return {"M": np.zeros_like(layers["M"]), "V": layers["V"], **light}


def masked(scene: Scene, variant: Path, folder: Path) -> Scene:
    """The scene with masks, kept in `folder`, of what drops of a variant cover."""
    views = []
    for view in scene.views:
        path = folder / f"{view.name}.png"
        if not path.is_file():
            write_ignored(path, layers_of(variant, view)["M"] > COVERED)
        views.append(replace(view, mask=path))
    return replace(scene, views=tuple(views))


def with_shares(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with the share of the gap between plain splatting on photographs and on clean views that is recovered.

    The share is NaN without the rows of plain splatting.
    """
    plain = rows[rows["method"] == PLAIN].set_index("photographs")["PSNR"]
    floors = rows["photographs"].str.removesuffix(", true cover hidden").map(plain)
    return rows.assign(
        **{"share of the gap": ((rows["PSNR"] - floors) / (plain.get("clean", np.nan) - floors)).round(2)}
    )


def main(
    scene: str = "courtyard",
    pattern: str = "window-1",
    profile: str = "demo",
    methods: tuple[str, ...] = (PLAIN, "deraings-plus"),
    only: tuple[str, ...] = (),
    data: Path = Path("data"),
    out: Path = Path("results/bench/windows"),
    seed: int = 0,
) -> None:
    """Train all cases and report.

    Args:
        scene: an embedded scene, a capture's name or its folder.
        pattern: window-0, window-1 or window-2.
        profile: demo or standard.
        methods: names, or `package.module:Class`; 3dgs is the floor and has to be among those trained before.
        only: train the cases whose names begin with one of these.
        data: where the built scene lies or goes.
        out: gets a folder for every scene, pattern, profile and seed, with windows.csv.
        seed: of the trainings.
    """
    built = build_source(scene, data / profile, find_profile(profile), patterns=(pattern,), all_patterns=False)
    drawn = sha256(built / pattern / PATTERN_FILE)[:8]  # another pane is another folder
    folder = out / f"{built.name}-{pattern}-{drawn}-{profile}-{seed}"
    chosen = {name: case for name, case in cases(built, pattern, folder).items() if not only or name.startswith(only)}
    csv = folder / "windows.csv"
    report(with_shares(train_all(chosen, methods, profile, seed, folder, csv)), csv)
