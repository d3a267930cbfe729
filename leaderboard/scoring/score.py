"""The second half of a run: what was rendered against the clean views, from files alone.

Protocol `hydroviews`: held-out views, clean ground truth, both 8-bit, full image; PSNR an image then the mean;
SSIM 11x11, sigma 1.5, valid window; LPIPS v0.1 on [-1, 1] with AlexNet and VGG. What masks hide of the ground truth
is left out: PSNR over the other pixels, SSIM over the windows without hidden ones, LPIPS with them grey in both.

A scene that was captured in rain, without clean photographs beside, has no ground truth: its runs are pictured, not
scored.
"""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.cli.threads import side_by_side
from hydroviews.dataset.variants import has_clean
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, sha256
from hydroviews.files.temporary import remove_leftovers
from hydroviews.formats.tables.csv_tables import write_csv
from hydroviews.metrics import Metric, find_metrics
from hydroviews.scene.images import Image, read_pixels, to_image, to_uint8
from hydroviews.scene.masks import Ignored
from hydroviews.scene.scenes import Scene, View
from leaderboard.records import (
    DONE,
    FIELDS,
    PER_VIEW,
    RAINY_POSES,
    SUBMITTED,
    Record,
    Status,
    checked_notes,
    code_version,
    status_of,
    write_record,
)
from leaderboard.runs.estimated_cameras import read_estimate
from leaderboard.runs.own_files import PREDICTION
from leaderboard.runs.run import CONFIG, Run, refuse_other_data
from leaderboard.scoring.previews import write_preview

AGAIN = f"remove its {PREDICTION}: the same command renders it again"
NO_TRUTH = "captured in rain: no clean ground truth"

Scores = dict[str, float | None]  # by metric


class UnusableRun(InputError):
    """Files that a run has left cannot be scored."""


def score(run: Run) -> Record:
    """Score the renders of a run: writes `per_view.csv`, `preview.png` and `record.json`.

    A metric that cannot be had (images too small for it, no network weights) stays empty, with the reason.

    Raises:
        InputError: there is no such run, it has not ended, or the data changed since.
        UnusableRun: a render is missing, damaged, not 8-bit RGB without alpha, or of another size than its clean view;
            what was noted of the run cannot be.
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
    remove_leftovers(run.folder)
    numbers = read_prediction(run.folder)
    if not has_clean(run.data / run.scene):
        return _record_unscored(run, numbers)
    clean = run.clean_scene()
    rows, scores, reasons = calculate(run, clean)
    views = pd.DataFrame(rows, columns=["view", *(metric.name for metric in find_metrics())])
    write_csv(run.folder / PER_VIEW, views)
    write_preview(run, clean)
    reason = "; ".join(f"{name}: {why}" for name, why in reasons.items())
    numbers |= {"scores": scores, "renders_sha256": renders_sha256(renders(run, clean))}
    record = describe(run, clean, status=status_of(scores), reason=reason, numbers=numbers)
    write_record(run.folder, record)
    return record


def read_prediction(folder: Path) -> dict[str, Any]:
    """What was noted of a run when it was trained and rendered: fields of its record.

    Raises:
        UnusableRun: fields are missing, are others, or hold what they cannot.
    """
    path = folder / PREDICTION
    try:
        numbers = read_json(path)
    except InputError as error:
        raise UnusableRun(f"{path}: cannot be read", found=str(error).splitlines()[0], fix=AGAIN) from None
    try:
        return checked_notes(numbers)
    except ValueError as error:
        raise UnusableRun(f"{path}: not what a run leaves", found=error, fix=AGAIN) from None


def _record_unscored(run: Run, numbers: Mapping[str, Any]) -> Record:
    """Write the preview and the record of a run that has no ground truth."""
    scene = run.training_scene()
    write_preview(run, scene)
    numbers = {**numbers, "renders_sha256": renders_sha256(renders(run, scene))}
    record = describe(run, scene, status=DONE, reason=NO_TRUTH, numbers=numbers)
    write_record(run.folder, record)
    return record


def calculate(run: Run, clean: Scene) -> tuple[list[dict[str, Any]], dict[str, float], dict[str, str]]:
    """All metrics of a run's renders, from the pictures; nothing is written.

    Returns:
        A row a view, with its name as `view`; the means by metric; and by metric why it could not be had.

    Raises:
        UnusableRun: as `score`.
    """
    reasons: dict[str, str] = {}
    rows = score_views(run.folder / "renders", clean.test_views, reasons)
    return rows, mean_scores(rows, reasons), reasons


def renders(run: Run, scene: Scene) -> list[Path]:
    """A run's renders, one for every held-out view."""
    return [run.folder / "renders" / f"{view.name}.png" for view in scene.test_views]


def renders_sha256(paths: Sequence[Path]) -> str:
    """SHA-256 over names and bytes of renders."""
    lines = [f"{sha256(path)} {path.name}" for path in sorted(paths, key=lambda path: path.name)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def mean_scores(views: Sequence[Mapping[str, Any]], reasons: dict[str, str]) -> dict[str, float]:
    """Rounded means over views; a metric without a score of a view, or an infinite one, is left out, with a reason."""
    table, means = pd.DataFrame(views), {}
    for metric in find_metrics():
        scores = table[metric.name].astype(float)
        mean, unknown = float(scores.mean(skipna=False)), int(scores.isna().sum())
        if np.isfinite(mean):
            means[metric.name] = round(mean, 5)
        elif unknown:
            reasons.setdefault(metric.name, f"not a number for {unknown} of {len(scores)} views")
        else:
            reasons.setdefault(metric.name, "infinite: a render equals its clean view")
    return means


def score_views(renders: Path, views: Sequence[View], reasons: dict[str, str]) -> list[dict[str, Any]]:
    """All metrics of all views, two views at a time, showing progress; why one cannot be had goes to `reasons`.

    What a metric cannot score of one view, of the first such view, says nothing of the others: each view's scores are
    its own, whichever is looked at first.
    """
    from baselines.training.torch_state import picture_threads

    find_metrics()  # once, not in both threads

    def scored(view: View) -> tuple[Scores, dict[str, str]]:
        return _score_view(renders / f"{view.name}.png", view, reasons)

    with picture_threads():
        found = list(tqdm(side_by_side(scored, views), desc="scoring", unit="view", total=len(views)))
    for _, faults in found:
        reasons.update(faults | reasons)
    return [{"view": view.name, **scores} for view, (scores, _) in zip(views, found, strict=True)]


def _score_view(render: Path, clean: View, reasons: dict[str, str]) -> tuple[Scores, dict[str, str]]:
    """All metrics of one view, from pictures on disk, as `_scores` has them."""
    try:
        pixels = read_pixels(render, "a render")
    except InputError as error:
        raise UnusableRun(f"{render}: not a render", found=str(error).splitlines()[0], fix=AGAIN) from None
    target = clean.image()
    found, expected = pixel_format(pixels), render_format(target.shape[1], target.shape[0])
    if found != expected:
        raise UnusableRun(f"{render}: not as renders are", found=found, expected=expected, fix=AGAIN)
    return _scores(to_image(pixels), target, clean.ignored(), reasons, find_metrics())


def render_format(width: int, height: int) -> str:
    """What `pixel_format` tells of a render: 8-bit RGB without alpha, of its clean view's size."""
    return f"8 bits, 3 channels, {width}x{height} pixels"


def pixel_format(pixels: NDArray[np.uint8 | np.uint16]) -> str:
    """Bits a channel, channels and size of a picture, [H, W] or [H, W, C], in words."""
    height, width, channels = (*pixels.shape, 1)[:3]
    return f"{8 * pixels.itemsize} bits, {channels} channels, {width}x{height} pixels"


def score_image(image: Image, clean: View, reasons: dict[str, str], metrics: Sequence[Metric] | None = None) -> Scores:
    """Metrics of one view by the protocol of this module.

    Args:
        image: float32 [H, W, 3] in [0, 1], which is rounded to 8 bits.
        clean: the ground truth, with its mask.
        reasons: by metric, why it could not be had; those in it already are not tried again.
        metrics: all there are if not given.
    """
    rounded = to_uint8(image).astype(np.float32) / 255
    scores, faults = _scores(rounded, clean.image(), clean.ignored(), reasons, metrics or find_metrics())
    reasons.update(faults)
    return scores


def _scores(
    image: Image, target: Image, ignored: Ignored | None, reasons: dict[str, str], metrics: Sequence[Metric]
) -> tuple[Scores, dict[str, str]]:
    """Metrics of an image of 8 bits a channel against its target, both [H, W, 3] in [0, 1].

    Returns:
        The scores, and by metric why these two images have none. What holds for all images, as that there are no
        weights, goes to `reasons` instead; metrics in it are not tried.
    """
    scores: Scores = dict.fromkeys(metric.name for metric in metrics)
    faults: dict[str, str] = {}
    for metric in metrics:
        if metric.name in reasons:
            continue
        try:
            scores[metric.name] = float(metric.function(image, target, ignored=ignored))
        except InputError as error:
            reasons.setdefault(metric.name, str(error).splitlines()[0])
        except ValueError as error:
            faults[metric.name] = str(error).splitlines()[0]
    return scores, faults


def describe(run: Run, scene: Scene, *, status: Status, reason: str, numbers: Mapping[str, Any]) -> Record:
    """The record of a run with the numbers that could be had."""
    settings = read_json(run.folder / CONFIG)
    submitted = settings.get(SUBMITTED, {})
    errors = dataclasses.asdict(read_estimate(run.cameras).errors) if run.track == RAINY_POSES else {}
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
        drawing_code=run.drawing_code(),
        submitted_by=submitted.get("by", ""),
        link=submitted.get("link", ""),
        **{name: value for name, value in errors.items() if name in FIELDS},
        **{"version": code_version(), **numbers},  # of the code that trained and rendered
    )
