"""A metric that another package registers goes through scoring, records and tables like ours."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_board import write_board as write_runs
from synthetic import capture_in

from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.formats.writers import write_colmap
from hydroviews.metrics import find_metrics
from hydroviews.scene.images import read_image
from leaderboard.evaluate import EvaluateRequest, evaluate
from leaderboard.gather import collect
from leaderboard.publishing.board_pages import write_board
from leaderboard.publishing.publish import publish
from leaderboard.records import read_record


@pytest.fixture
def register(tmp_path, monkeypatch):
    """Registers an object of `toy_metric` as an installed package would."""

    def register_it(value: str) -> None:
        package = tmp_path / "site" / "toy-1.dist-info"
        package.mkdir(parents=True)
        (package / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1\n")
        (package / "entry_points.txt").write_text(f"[hydroviews.metrics]\nlargest = {value}\n")
        monkeypatch.syspath_prepend(str(package.parent))
        monkeypatch.syspath_prepend(str(Path(__file__).parent))
        find_metrics.cache_clear()

    find_metrics.cache_clear()
    yield register_it
    find_metrics.cache_clear()


@pytest.mark.usefixtures("toys", "trained_here")
def test_a_registered_metric_goes_through_everything(tmp_path, register):
    register("toy_metric:LARGEST_ERROR")
    capture = tmp_path / "yard"
    write_colmap(capture_in(capture), capture / "sparse" / "0")
    results = tmp_path / "results"
    record = evaluate(
        EvaluateRequest(
            "toy_methods:MeanColour",
            scene=str(capture),
            patterns=("streak-0",),
            data=tmp_path / "data",
            results=results,
        )
    )[-1]
    run = results / "demo/toy_methods.MeanColour/yard/streak-0/seed-0"
    clean = tmp_path / "data/demo/yard/clean"
    errors = [
        np.abs(read_image(path) - read_image(clean / path.name)).max() for path in sorted((run / "renders").iterdir())
    ]
    assert pd.read_csv(run / "per_view.csv").largest_error.tolist() == pytest.approx(errors)
    assert record.scores["largest_error"] == pytest.approx(np.mean(errors), abs=1e-5)
    assert read_record(run / "record.json") == record
    table = pd.read_csv(results / "leaderboard.csv")
    assert list(table.columns)[12:18] == ["psnr", "ssim", "lpips_alex", "lpips_vgg", "largest_error", "train_s"]
    assert record.scores["largest_error"] in table.largest_error.tolist()
    text = (results / "tables.md").read_text()
    assert "| streak | PSNR | SSIM | LPIPS | LPIPS-VGG | largest error | share of gap |" in text
    assert f" | **{record.scores['largest_error']:.3f}** | " in text
    assert "\nPSNR, SSIM: higher is better; LPIPS, LPIPS-VGG, largest error: lower is better. Bold: best." in text
    find_metrics.cache_clear()


def test_runs_of_before_a_metric_was_registered_are_published_and_shown(tmp_path, register):
    results, board, out = (tmp_path / name for name in ("results", "board", "out"))
    write_runs(results, ("3dgs", "3dgs-clean", "ours"), ("pond",), ("streak-1",), size=(16, 16))
    register("toy_metric:LARGEST_ERROR")
    assert len(publish(results, board).written) == 3
    assert write_board(board, out).is_file()
    assert set(collect(out).status) == {"partial"}  # here: on the board they are done
    comparisons = (out / "comparisons.md").read_text()
    assert "given-poses: PSNR\n\n| rank | method |" in comparisons
    assert "given-poses: largest error\n\nno run that all methods have finished" in comparisons


def test_a_record_outlives_a_metric_that_is_no_longer_registered(tmp_path, register):
    written = {
        "psnr": 20.0,
        "largest_error": 0.5,
        "method": "m",
        "scene": "s",
        "effect": "e",
        "pattern": "p",
        "seed": 0,
    }
    written |= {"track": "given-poses", "status": "done", "reason": "", "n_train": 1, "n_test": 1}
    write_json(tmp_path / "record.json", {**written, "width": 1, "height": 1})
    assert read_record(tmp_path / "record.json").scores == {"psnr": 20.0}
    register("toy_metric:LARGEST_ERROR")
    assert read_record(tmp_path / "record.json").scores == {"psnr": 20.0, "largest_error": 0.5}
    write_json(tmp_path / "record.json", {**written, "width": 1, "height": 1, "colour": "red"})
    with pytest.raises(InputError, match="not a record of this version"):
        read_record(tmp_path / "record.json")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("toy_metric:BROKEN", "is not a metric"),
        ("toy_metric:ABSENT", "cannot import"),
        ("hydroviews.metrics.registry:METRICS", "is not a metric"),
    ],
)
def test_what_is_no_metric_is_refused(register, value, message):
    register(value)
    with pytest.raises(InputError, match=message):
        find_metrics()
