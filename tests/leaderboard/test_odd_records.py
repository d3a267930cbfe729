"""Records and predictions that were edited, cut or moved: a row with a reason, and never the end of a table."""

import logging
import shutil
from pathlib import Path

import pandas as pd
import pytest
from damage import edit
from in_the_way import KINDS, not_for_ever, swap

from hydroviews.errors import InputError
from leaderboard.__main__ import table_command
from leaderboard.evaluate import evaluate
from leaderboard.gather import collect, collect_views, write_leaderboard
from leaderboard.records import LONGEST, columns, printable
from leaderboard.tables.rain_losses import record_losses

RUN = "demo/toy_methods.MeanColour/yard/streak-0/seed-0"
pytestmark = pytest.mark.usefixtures("toys", "trained_here")


@pytest.fixture
def results(evaluated, tmp_path) -> Path:
    return tmp_path / "results"


def row(results: Path) -> pd.Series:
    """Of the edited run; the other one is as it was, and all of them are in the CSV."""
    table = write_leaderboard(results)
    assert len(table) == len(pd.read_csv(results / "leaderboard.csv")) == 2
    assert table.status[0] == "done"
    assert list(table.columns) == columns()
    return table.iloc[1]


def test_a_run_that_is_removed_while_tables_are_written_is_left_out_of_the_views(results, caplog):
    table = collect(results)
    shutil.rmtree(results / RUN)  # as another process may, once its record has been read
    assert set(collect_views(table, results).method) == {"toy_methods:MeanColourClean"}
    assert f"{RUN}: its views are not counted" in caplog.text


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"psnr": 99}, "its scores are not those of its views"),
        ({"psnr": "a string"}, "psnr 'a string'"),
        ({"psnr": [1, 2]}, r"psnr \[1, 2\]"),
        ({"psnr": float("nan")}, "psnr nan"),
        ({"psnr": True}, "psnr True"),
        ({"psnr": 10**400}, "not valid JSON"),
        ({"method": "../../x"}, "the record of another run"),
        ({"method": None}, "method None: input should be a valid string"),
        ({"seed": "a string"}, "seed 'a string': input should be a valid integer"),
        ({"seed": -1}, "seed -1"),
        ({"scene": "a|b\nc"}, "the record of another run"),
        ({"n_test": 3}, "its scores are not those of its views"),
        ({"n_test": 2.5}, "n_test 2.5"),
        ({"train_s": float("inf")}, "train_s inf"),
        ({"train_s": -3.0}, "train_s -3.0"),
        ({"status": "excellent"}, "status 'excellent': input should be 'done', 'partial', 'failed'"),
        ({"reason": None}, "reason None: input should be a valid string"),
        ({"colour": "red"}, "colour 'red': input should be a valid number"),
        ({"status": "unreadable"}, "status unreadable, expected one that is written down"),
        ({"schema": 3}, "schema 3, expected 1 to 2: written by another version"),
        ({"schema": "new"}, "schema 'new', expected 1 to 2"),
    ],
)
def test_an_edited_record_is_a_row_with_a_reason(results, changes, reason, caplog):
    edit(results / RUN / "record.json", **changes)
    found = row(results)
    assert found.status == "unreadable"
    assert tuple(found[["method", "scene", "pattern", "seed"]]) == ("toy_methods.MeanColour", "yard", "streak-0", 0)
    assert pd.Series([found.reason]).str.contains(reason).all(), found.reason
    assert found[["psnr", "n_test", "train_s"]].isna().all()
    assert "not counted" in caplog.text


RECORDS = (b"", b"[]", b'{"psnr"', b"null", b"\xff", b"{}", b"[" * 100_000, b'{"seed": ' + b"1" * 5000 + b"}")
VIEWS = (None, b"", b"view,psnr\nview-00,1\nview-08,1\n", b"\xff", b"view,psnr\nview-00\n")


@pytest.mark.parametrize(
    ("name", "content"), [*(("record.json", one) for one in RECORDS), *(("per_view.csv", one) for one in VIEWS)]
)
def test_a_run_whose_record_or_views_are_damaged_is_unreadable(results, name, content):
    path = results / RUN / name
    path.unlink() if content is None else path.write_bytes(content)
    assert row(results).status == "unreadable"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["record.json", "per_view.csv"])
def test_something_else_where_a_file_of_a_run_belongs_is_a_row_with_a_reason(results, name, kind):
    swap(results / RUN / name, kind)
    with not_for_ever():
        odd = row(results)
    assert odd.status == "unreadable"
    assert f"{name}: not a file" in odd.reason
    assert f"a {kind}" in odd.reason


@pytest.mark.parametrize("name", ["leaderboard.csv", "per_view.csv", "tables.md", "costs.csv"])
def test_a_folder_where_a_table_belongs_gets_another_name(results, name, caplog):
    swap(results / name, "folder")
    (results / name / "notes.txt").write_text("mine")
    write_leaderboard(results)
    assert (results / f"{name}.kept" / "notes.txt").read_text() == "mine"
    assert (results / name).is_file()
    assert f"it is now called {name}.kept" in caplog.text


@pytest.mark.parametrize("kind", KINDS)
def test_something_else_where_the_table_belongs_that_a_card_is_made_of_is_refused(results, kind):
    swap(results / "leaderboard.csv", kind)
    with not_for_ever(), pytest.raises(InputError, match=r"leaderboard\.csv: not a file"):
        record_losses(results.parent / "data/demo/yard", results)


def test_a_run_that_was_moved_is_a_row_and_a_copy_beside_it_is_told(results, caplog):
    run = results / RUN
    shutil.copytree(run, run.with_name("seed-0 of before"))
    shutil.copytree(run.parents[1], run.parents[1].with_name("garden"))
    table = write_leaderboard(results)
    assert list(table.scene + " " + table.status) == ["garden unreadable", "yard done", "yard done"]
    assert "move the run back, or remove it" in table.reason[0]
    assert "seed-0 of before/record.json: the record of another run" in caplog.text


@pytest.fixture
def again(request_of):
    """Evaluates once more; the record."""
    return lambda: evaluate(request_of())[-1]


def spoil(path: Path, content: str | dict) -> None:
    """Write something else into a file, or edit some of its values."""
    path.write_text(content) if isinstance(content, str) else edit(path, **content)


@pytest.mark.parametrize("content", ['{"psnr"', '{"psnr": 99}', {"psnr": 99}])
def test_evaluated_again_an_odd_record_is_scored_anew(results, again, evaluated, caplog, content):
    spoil(results / RUN / "record.json", content)
    assert again() == evaluated
    assert "not kept" in caplog.text
    assert list(collect(results).status) == ["done", "done"]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{}", "no train_s; no render_fps"),
        ({"hack": 1}, "unknown hack"),
        ({"train_s": "fast"}, "train_s 'fast'"),
        ({"model_mb": float("nan")}, "model_mb nan"),
        ("[]", "a list"),
        ('{"train_s"', "cannot be read"),
    ],
)
def test_evaluated_again_an_odd_prediction_is_a_failed_row(results, again, content, reason):
    run = results / RUN
    (run / "record.json").unlink()
    spoil(run / "prediction.json", content)
    record = again()
    assert record.status == "failed"
    assert reason in record.reason
    assert "remove its prediction.json: the same command renders it again" in record.reason


def test_a_render_that_is_damaged_is_a_failed_row_that_says_how_to_render_again(results, again, evaluated):
    run = results / RUN
    (run / "record.json").unlink()
    (run / "renders" / "view-00.png").write_bytes(b"")
    record = again()
    assert record.status == "failed"
    assert "view-00.png: not a render" in record.reason
    (run / "prediction.json").unlink()
    assert again().scores == evaluated.scores


def test_settings_that_were_cut_are_refused_with_a_way_out(results, again, evaluated_once):
    config = results / RUN / "config.json"
    config.write_text(config.read_text()[:20])
    with pytest.raises(InputError, match=r"config.json: not valid JSON[\s\S]*add --overwrite"):
        again()


def test_where_nothing_may_be_written_the_table_is_there(results, again, monkeypatch, capsys, caplog):
    def refused(*_):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("hydroviews.files.atomic.os.replace", refused)
    assert again().status == "done"
    assert "leaderboard.csv: cannot be written" in caplog.text
    caplog.set_level(logging.ERROR)
    table_command(results)
    assert "| toy_methods:MeanColour |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("as it is\nin lines, with ü", "as it is\nin lines, with ü"),
        ("\ud800 \x1b[0m \x00", r"\ud800 \x1b[0m \x00"),
        ("x" * LONGEST, "x" * LONGEST),
    ],
)
def test_text_is_made_printable_and_cut(text, shown):
    assert printable(text) == printable(shown) == shown
    long = printable(text * 2000)
    assert len(long) == LONGEST
    assert long.endswith(",000 characters)")
