"""Effects and metrics of one's own, in one file each, go the whole way: builds, scoring, records and tables."""

import json

import numpy as np
import pandas as pd
import pytest
from made_up_board import write_board as write_runs

from examples.brightness import brightness_error
from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.statistics import read_statistics
from hydroviews.dataset.suites import read_suite
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.metrics import find_metrics
from hydroviews.rain.registry import choose_patterns, find_effect
from hydroviews.scene.images import read_image, write_png
from leaderboard.evaluate import evaluate
from leaderboard.gather import collect
from leaderboard.publishing.board_pages import write_board
from leaderboard.publishing.publish import publish
from leaderboard.records import read_record
from leaderboard.tables.dataframes import scene_table
from leaderboard.tables.markdown import to_markdown

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


ASH = "toy_effect.Ash"  # in names of folders, where a colon may not stand


@pytest.mark.usefixtures("toys", "trained_here")
def test_from_build_to_table(tmp_path, request_of):
    evaluate(request_of(patterns=("toy_effect:Ash-0", "toy_effect:Ash-2")))
    data = tmp_path / "data" / "demo"
    folder = data / "yard"

    facts = json.loads((folder / f"{ASH}-2" / "pattern.json").read_text())
    assert (facts["effect"], facts["grade"], facts["parameters"]["cover"]) == (ASH, "heavy", 0.2)
    assert verify(data, every_view=True) == []
    rows = read_statistics(folder / f"{ASH}-2" / "statistics.csv")
    assert rows.water.mean() == pytest.approx(0.2, abs=0.02)
    assert rows[["mist", "streaks", "angle", "seed_density"]].isna().all(axis=None)
    assert f"* **{ASH}-2**: ash over 20% of the picture, of grey 0." in (folder / "README.md").read_text()
    assert all(read_image(path).std() > 0 for path in write_sheets(folder))

    board = pd.read_csv(tmp_path / "results" / "leaderboard.csv")
    assert sorted(set(board.effect)) == ["clean", ASH]
    assert set(board.drawing_code[board.pattern == f"{ASH}-2"]) == {facts["drawing_code"]}
    assert facts["drawing_code"] not in set(board.drawing_code[board.effect == "clean"])
    assert ASH in to_markdown(scene_table(board, "yard", "demo", "given-poses"))

    image = folder / f"{ASH}-0" / "images" / "view-00.png"
    write_png(image, read_image(image) * 0.5)
    assert any("differs by" in problem for problem in verify(data))


def test_an_effect_of_ones_own_is_named_by_patterns_and_suites(tmp_path):
    assert [pattern.name for pattern in choose_patterns((), (0, 1), ["toy_effect:Ash"])] == [f"{ASH}-0", f"{ASH}-1"]
    assert choose_patterns([f"{ASH}-1"], ()) == choose_patterns(["toy_effect:Ash-1"], ())
    suite = tmp_path / "mine.toml"
    suite.write_text('[scenes]\nyard = ["toy_effect:Ash"]')
    assert read_suite(str(suite)).scenes == {"yard": ("toy_effect:Ash",)}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hail", "no such effect\n.*\n.*raindrop.*streak.*, or package.module:Class"),
        ("toy_effect:Hail", "cannot import toy_effect:Hail\n.*AttributeError"),
        ("no_such_module:Hail", "cannot import no_such_module:Hail\n.*ModuleNotFoundError"),
        ("toy_effect:AshPattern", "not an effect"),
        (":Hail", "no such effect"),
    ],
)
def test_what_is_no_effect_is_told(name, message):
    with pytest.raises(InputError, match=message):
        find_effect(name)
