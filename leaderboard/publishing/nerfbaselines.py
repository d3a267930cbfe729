"""A run's scores as `results.json` of nerfbaselines: metrics by view as little-endian float32 in base64.

Its layout is that of nerfbaselines 1.2 (Kulhanek and Sattler 2024). Scores are those of our protocol, which the file
names, so that no table mixes them with scores of another.
"""

import base64
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.files.ownership import require_ours
from hydroviews.formats.csv_tables import read_csv
from leaderboard.gather import trusted_record
from leaderboard.records import PER_VIEW, Record

PROTOCOL = "hydroviews"
NAMES = {"lpips_alex": "lpips"}  # what nerfbaselines calls otherwise
DIGITS = 5  # of means, as nerfbaselines rounds them


def write_results(folder: Path, out: Path) -> None:
    """Write a run's scores for nerfbaselines, without metrics that could not be had.

    Args:
        folder: of a run with scores.
        out: the file, .json.

    Raises:
        InputError: no such run, one without scores, another suffix, or a file of somebody else's has that name.
    """
    if out.suffix.lower() != ".json":
        raise InputError(f"--out {out}: not a file of results", expected="a name that ends in .json")
    require_ours([out])
    record = trusted_record(folder.resolve())
    if not record.scores:
        raise InputError(f"{folder}: has no scores", found=record.reason or record.status)
    views = read_csv(folder / PER_VIEW, texts=["view"])
    scores = {NAMES.get(name, name): views[name].tolist() for name in views.columns if name in record.scores}
    write_json(out, as_results(record, scores))


def as_results(record: Record, scores: Mapping[str, list[float]]) -> dict[str, Any]:
    """A record in the layout of nerfbaselines.

    Args:
        record: of the run.
        scores: of its held-out views, by metric, in the order of their names.
    """
    data_set = {
        "id": f"hydroviews-{record.profile}",
        "scene": record.scene if record.pattern == CLEAN else f"{record.scene}-{record.pattern}",
        "evaluation_protocol": PROTOCOL,
    }
    return {
        "nb_info": {
            "method": record.method,
            "dataset_metadata": data_set,
            "seed": record.seed,
            "track": record.track,
            "version": record.version,
            "data_sha256": record.data_sha256,
            **_known({"total_train_time": record.train_s}),
            "resources_utilization": _known({"memory": record.peak_mem_mb, "gpu_memory": record.peak_gpu_mem_mb}),
        },
        "render_dataset_metadata": data_set,
        "metrics": {name: round(float(np.mean(values)), DIGITS) for name, values in scores.items()},
        "metrics_raw": {name: _encoded(values) for name, values in scores.items()},
        "metrics_sha256": _digest(scores),
        "predictions_sha256": record.renders_sha256,
        "evaluation_protocol": PROTOCOL,
    }


def _known(numbers: dict[str, float | None]) -> dict[str, float | None]:
    """Those that are there: nerfbaselines takes means of all that it finds."""
    return {name: value for name, value in numbers.items() if value is not None}


def _encoded(values: list[float]) -> str:
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()


def _digest(scores: Mapping[str, list[float]]) -> str:
    """Of all scores, whatever the order of views: as nerfbaselines checks it."""
    lines = [f"{name.lower()}{_encoded(sorted(scores[name]))}\n" for name in sorted(scores)]
    return hashlib.sha256("".join(lines).encode()).hexdigest()
