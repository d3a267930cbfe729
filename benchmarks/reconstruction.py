"""What `deraings reconstruct` makes of rainy photographs without cameras: how right these are, and how clean the scene.

    python -m benchmarks.reconstruction data/demo/courtyard --patterns raindrop-1 streak-1

Hands a built scene's rainy photographs to `reconstruct`, without their cameras and with nothing held out. Compares the
cameras with the scene's own, and renders from where the photographs were taken, as well as the photographs themselves,
with the clean views. Prints a table and writes reconstruction.csv. An interrupted run goes on where it stopped.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tyro

from baselines.method import find_method
from baselines.rendering.film import FilmChoice
from benchmarks.poses import SPENT, linked
from benchmarks.timing import counted, counted_seconds
from deraings.reconstruct import CAPTURE, TRAINING, Reconstruction, all_views, find_scene, reconstruct
from hydroviews.captures.sfm.mapping import TooFewRegistered
from hydroviews.cli.commands import run_command
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.files.atomic import read_json, write_bytes, write_json
from hydroviews.metrics.psnr import psnr
from hydroviews.profiles import find_profile
from hydroviews.scene.camera_errors import compare_cameras
from hydroviews.scene.scenes import View

ROW = "row.json"
SCORED = 8  # every so manieth view
FILM = FilmChoice(seconds=1, fps=8, size=320)  # a short one: it is not what is measured


def reconstructed(rainy: tuple[View, ...], clean: tuple[View, ...], request: Reconstruction) -> dict[str, Any]:
    """Reconstruct from the photographs of some views in rain, and compare with the same views without: a row."""
    named = dict(zip(linked(rainy, request.photographs), clean, strict=True))
    true = {name: view.camera.world_to_camera for name, view in named.items()}
    spent = request.photographs.with_name(SPENT)
    try:
        with counted(spent):
            reconstruct(request)
    except TooFewRegistered as error:
        return _row(compare_cameras({}, true)[0], error.registered)
    seconds = round(counted_seconds(spent))
    scene = all_views(find_scene(request, request.folder / CAPTURE))  # kept by `reconstruct`
    errors, _ = compare_cameras({view.name: view.camera.world_to_camera for view in scene.views}, true)
    scene = scene.resized(request.long_side or find_profile(request.profile).long_side)
    kind = find_method(request.method)
    model = kind.load(kind.configuration(request.profile), request.seed, request.folder / TRAINING)
    scores = []
    for view in scene.views[::SCORED]:
        target = replace(view, path=named[view.name].path).image()  # through the same lens
        scores.append([float(psnr(picture, target)) for picture in (view.image(), model.render(view.camera))])
    before, after = np.mean(scores, axis=0).round(2).tolist()
    return _row(errors, errors.registered) | {"photographs_psnr": before, "renders_psnr": after, "cpu_s": seconds}


def _row(errors: Any, registered: int) -> dict[str, Any]:
    areas = {name: round(getattr(errors, name), 3) for name in ("pose_auc_5", "pose_auc_10", "pose_auc_30")}
    return {"photographs": errors.photographs, "registered": registered, **areas}


def main(
    scenes: tyro.conf.Positional[tuple[Path, ...]],
    patterns: tuple[str, ...] = ("raindrop-1", "streak-1"),
    every: int = 1,
    method: str = Reconstruction.method,
    profile: str = "demo",
    out: Path = Path("results/bench/reconstruction"),
    seed: int = 0,
) -> None:
    """Reconstruct all patterns of all scenes and report.

    Args:
        scenes: folders of built scenes.
        patterns: rainy variants.
        every: take every so manieth view.
        method: that learns.
        profile: of the method.
        out: gets a folder for every scene and pattern, with reconstruction.csv.
        seed: of cameras and training.
    """
    rows: list[dict[str, Any]] = []
    for scene in scenes:
        for pattern in patterns:
            rainy, clean = (one.views[::every] for one in (open_variant(scene, pattern), open_clean(scene)))
            folder = out / f"{scene.resolve().name}-{pattern}-{every}-{method}-{profile}-{seed}"
            request = Reconstruction(folder / "photographs", folder / "scene", method, profile, seed=seed, film=FILM)
            if not (folder / ROW).is_file():
                write_json(folder / ROW, reconstructed(rainy, clean, request))
            rows.append({"scene": scene.resolve().name, "pattern": pattern} | read_json(folder / ROW))
            write_bytes(out / "reconstruction.csv", pd.DataFrame(rows).to_csv(index=False).encode())
    print(f"\n{pd.DataFrame(rows).to_string(index=False)}")


if __name__ == "__main__":
    run_command(main, prog="benchmarks.reconstruction")
