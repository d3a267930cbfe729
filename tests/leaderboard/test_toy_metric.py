"""A metric that another package registers, as the example does, goes through scoring, records and tables like ours."""

import numpy as np
import pandas as pd
import pytest
from made_up_board import write_board as write_runs

from examples.brightness import brightness_error
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.metrics import find_metrics
from hydroviews.scene.images import read_image
from leaderboard.evaluate import evaluate
from leaderboard.gather import collect
from leaderboard.publishing.board_pages import write_board
from leaderboard.publishing.publish import publish
from leaderboard.records import read_record

EXAMPLE = "examples.brightness:BRIGHTNESS"


@pytest.fixture
def register(tmp_path, monkeypatch):
    """Registers an object as a metric, as an installed package would."""

    def register_it(value: str) -> None:
        package = tmp_path / "site" / "toy-1.dist-info"
        package.mkdir(parents=True)
        (package / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1\n")
        (package / "entry_points.txt").write_text(f"[hydroviews.metrics]\nbrightness = {value}\n")
        monkeypatch.syspath_prepend(str(package.parent))
        find_metrics.cache_clear()

    find_metrics.cache_clear()
    yield register_it
    find_metrics.cache_clear()


@pytest.mark.usefixtures("toys", "trained_here")
def test_a_registered_metric_goes_through_everything(tmp_path, register, request_of):
    register(EXAMPLE)
    record = evaluate(request_of())[-1]
    results, clean = tmp_path / "results", tmp_path / "data/demo/yard/clean"
    run = results / "demo/toy_methods.MeanColour/yard/streak-0/seed-0"
    renders = sorted((run / "renders").iterdir())
    errors = [255 * abs(read_image(path).mean() - read_image(clean / path.name).mean()) for path in renders]
    assert pd.read_csv(run / "per_view.csv").brightness.tolist() == pytest.approx(errors, rel=1e-4)
    assert record.scores["brightness"] == pytest.approx(np.mean(errors), rel=1e-4)
    assert read_record(run / "record.json") == record
    table = pd.read_csv(results / "leaderboard.csv")
    assert list(table.columns)[12:18] == ["psnr", "ssim", "lpips_alex", "lpips_vgg", "brightness", "train_s"]
    assert record.scores["brightness"] in table.brightness.tolist()
    text = (results / "tables.md").read_text()
    assert "| streak | PSNR | SSIM | LPIPS | LPIPS-VGG | brightness error | share of gap |" in text
    assert f" | **{record.scores['brightness']:.2f}** | " in text
    assert "\nPSNR, SSIM: higher is better; LPIPS, LPIPS-VGG, brightness error: lower is better. Bold: best." in text


def test_runs_of_before_a_metric_was_registered_are_published_and_shown(tmp_path, register):
    results, board, out = (tmp_path / name for name in ("results", "board", "out"))
    write_runs(results, ("3dgs", "3dgs-clean", "ours"), ("pond",), ("streak-1",), size=(16, 16))
    register(EXAMPLE)
    assert len(publish(results, board).written) == 3
    assert write_board(board, out).is_file()
    assert set(collect(out).status) == {"partial"}  # here: on the board they are done
    comparisons = (out / "comparisons.md").read_text()
    assert "given-poses: PSNR\n\n| rank | method |" in comparisons
    assert "given-poses: brightness error\n\nno run that all methods have finished" in comparisons


def test_a_record_outlives_a_metric_that_is_no_longer_registered(tmp_path, register):
    written = {"psnr": 20.0, "brightness": 0.5, "method": "m", "scene": "s", "effect": "e", "pattern": "p", "seed": 0}
    written |= {"track": "given-poses", "status": "done", "reason": "", "n_train": 1, "n_test": 1}
    written |= {"width": 1, "height": 1}
    path = tmp_path / "record.json"
    write_json(path, written)
    assert read_record(path).scores == {"psnr": 20.0}
    register(EXAMPLE)
    assert read_record(path).scores == {"psnr": 20.0, "brightness": 0.5}
    write_json(path, written | {"colour": "red"})
    with pytest.raises(InputError, match="not a record of this version"):
        read_record(path)


@pytest.mark.parametrize(
    ("value", "message"),
    [("hydroviews.metrics.registry:METRICS", "is not a metric"), ("examples.brightness:ABSENT", "cannot import")],
)
def test_what_is_no_metric_is_refused(register, value, message):
    register(value)
    with pytest.raises(InputError, match=message):
        find_metrics()


def test_the_example_is_the_distance_of_the_means_of_what_is_shown():
    target = np.full((4, 6, 3), 0.5, np.float32)
    image = target.copy()
    image[:, :3] += np.float32(10 / 255)
    assert brightness_error(image, target) == pytest.approx(5, abs=1e-4)
    ignored = np.zeros((4, 6), bool)
    ignored[:, 3:] = True
    assert brightness_error(image, target, ignored=ignored) == pytest.approx(10, abs=1e-4)
