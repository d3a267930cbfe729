"""The second half of a run: what was rendered against the clean views, from files alone.

Protocol `hydroviews`: held-out views, clean ground truth, both 8-bit, full image; PSNR an image then the mean;
SSIM 11x11, sigma 1.5, valid window; LPIPS v0.1 on [-1, 1] with AlexNet and VGG. What masks hide of the ground truth
is left out: PSNR over the other pixels, SSIM over the windows without hidden ones, LPIPS with them grey in both.

A scene that was captured in rain has no clean ground truth: its runs are pictured, not scored.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from hydroviews import metrics
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, replacing
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.scene.images import read_image
from hydroviews.scene.scenes import Scene, View
from leaderboard.predict import PREDICTION
from leaderboard.previews import write_preview
from leaderboard.records import Record, code_version, write_record
from leaderboard.runs import CONFIG, Run, refuse_other_data

PER_VIEW = "per_view.csv"
NO_TRUTH = "captured in rain: no clean ground truth"
METRICS: dict[str, Callable] = {
    "psnr": metrics.psnr,
    "ssim": metrics.ssim,
    "lpips_alex": partial(metrics.lpips, net="alex"),
    "lpips_vgg": partial(metrics.lpips, net="vgg"),
}


def score(run: Run) -> Record:
    """Score the renders of a run: writes `per_view.csv`, `preview.png` and `record.json`.

    A metric that cannot be had (images too small for it, no network weights) stays empty, with the reason.

    Raises:
        InputError: a render is missing, or of another size than its clean view; there is no such run, it has
            not ended, or the data changed since.
    """
    if not (run.folder / CONFIG).is_file():
        raise InputError(
            f"{run}: no such run", found=f"no {run.folder / CONFIG}", fix=f"make eval METHOD={run.method} first"
        )
    refuse_other_data(run, "evaluate it anew with --overwrite (make eval OVERWRITE=1)")
    if not (run.folder / PREDICTION).is_file():
        raise InputError(
            f"{run}: not trained to its end, or not rendered",
            found=f"no {run.folder / PREDICTION}",
            fix=f"make eval METHOD={run.method} goes on where it stopped",
        )
    if run.pattern == CAPTURED:
        return _picture(run)
    clean = run.clean_scene()
    reasons: dict[str, str] = {}
    rows = [
        {"view": view.name, **score_view(run.folder / "renders" / f"{view.name}.png", view, reasons)}
        for view in tqdm(clean.test_views, desc="scoring", unit="view")
    ]
    views = pd.DataFrame(rows, columns=["view", *METRICS])
    with replacing(run.folder / PER_VIEW) as temporary:
        views.to_csv(temporary, index=False)
    write_preview(run, clean)
    means = {name: _mean(views[name]) for name in METRICS}
    for name in METRICS:
        if means[name] is None and name not in reasons:
            reasons[name] = "infinite: a render equals its clean view"
    reason = "; ".join(f"{name}: {why}" for name, why in reasons.items())
    numbers = {**means, **read_json(run.folder / PREDICTION)}
    record = describe(run, clean, status="done", reason=reason, numbers=numbers)
    write_record(run.folder, record)
    return record


def _picture(run: Run) -> Record:
    """Write the preview and the record of a run that has no ground truth."""
    scene = run.training_scene()
    write_preview(run, scene)
    record = describe(run, scene, status="done", reason=NO_TRUTH, numbers=read_json(run.folder / PREDICTION))
    write_record(run.folder, record)
    return record


def _mean(scores: pd.Series) -> float | None:
    """Rounded mean; None where a view has no score or an infinite one."""
    mean = float(scores.mean(skipna=False)) if scores.notna().all() else float("nan")
    return round(mean, 5) if np.isfinite(mean) else None


def score_view(render: Path, clean: View, reasons: dict[str, str]) -> dict[str, float | None]:
    """All metrics of one view, from pictures on disk; what cannot be had goes to `reasons`."""
    image, target, ignored = read_image(render), read_image(clean.path), clean.ignored()
    if image.shape != target.shape:
        raise InputError(
            f"{render}: another size than the clean view",
            found=f"{image.shape[1]}x{image.shape[0]}",
            expected=f"{target.shape[1]}x{target.shape[0]}",
            fix="delete the run and evaluate again",
        )
    scores: dict[str, float | None] = {}
    for name, metric in METRICS.items():
        try:
            scores[name] = None if name in reasons else metric(image, target, ignored=ignored)
        except (InputError, ValueError) as error:
            scores[name], reasons[name] = None, str(error).splitlines()[0]
    return scores


def describe(run: Run, scene: Scene, *, status: str, reason: str, numbers: Mapping[str, Any]) -> Record:
    """The record of a run with the numbers that could be had."""
    settings = read_json(run.folder / CONFIG)
    camera = scene.test_views[0].camera
    return Record(
        method=run.method,
        scene=run.scene,
        effect=run.effect,
        pattern=run.pattern,
        seed=run.seed,
        track=run.track,
        status=status,
        reason=reason,
        n_train=len(scene.split.train),
        n_test=len(scene.split.test),
        width=camera.width,
        height=camera.height,
        profile=run.profile,
        data_sha256=settings["data_sha256"],
        **{"version": code_version(), **numbers},  # of the code that trained and rendered
    )
