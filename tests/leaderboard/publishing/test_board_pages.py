"""What a board shows: written elsewhere, whole, and without what is no longer there; the board stays as it is."""

import shutil
from pathlib import Path

import pandas as pd
import pytest
from damage import edit, files
from made_up_board import write_board as make_runs

from hydroviews.errors import InputError
from leaderboard import gather
from leaderboard.__main__ import board_command, compare_command, site_command, table_command
from leaderboard.gather import collect, collect_views, run_folders
from leaderboard.publishing.board_pages import comparisons_text, write_board
from leaderboard.publishing.publish import publish
from leaderboard.tables.comparison import compare

METHODS = ("3dgs", "3dgs-clean", "ours")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A results folder with renders, and a board of it."""
    folder = tmp_path_factory.mktemp("made")
    make_runs(folder / "results", METHODS, ("pond", "room", "courtyard"), ("raindrop-1", "streak-1"), size=(16, 16))
    publish(folder / "results", folder / "board")
    return folder


@pytest.fixture
def board(made, tmp_path, monkeypatch):
    """The board, in place of the one that ships."""
    folder = Path(shutil.copytree(made / "board", tmp_path / "board"))
    monkeypatch.setattr(gather, "BOARD", folder)
    return folder


@pytest.fixture(scope="module")
def shown(made):
    """What the board shows."""
    assert write_board(made / "board", made / "out") == made / "out" / "site" / "index.html"
    return made / "out"


def test_all_tables_comparisons_and_pages_are_written_beside_a_board_that_stays_as_it_is(made, shown):
    publish(made / "results", made / "again")
    assert files(made / "board") == files(made / "again")
    written = {path.name for path in shown.iterdir() if path.is_file() and path.name[0] != "."}
    tables = {f"{name}.csv" for name in ("leaderboard", "per_view", "tables", "grades", "costs", "ablation")}
    assert written == {*tables, "tables.md", "tables.tex", "comparisons.md"}
    assert len(pd.read_csv(shown / "leaderboard.csv")) == 15
    assert len(list((shown / "site" / "pictures").iterdir())) == 45  # three renders of each run
    assert len(list((shown / "site" / "runs").iterdir())) == 15


def test_comparisons_are_of_every_suite_and_metric(board, shown):
    text = (shown / "comparisons.md").read_text()
    assert text.count("## Suite test, demo, given-poses: ") == text.count("## Suite development, demo, ") == 4
    table = collect(board)
    rows = table[table.scene != "courtyard"]
    row = compare(rows, collect_views(rows, board), "psnr").methods.iloc[0]
    section = text.split("## ")[1]
    assert section.startswith("Suite test, demo, given-poses: PSNR")
    assert f"| 1 | {row.method} | {row['mean']:.2f} [{row.low:.2f}, {row.high:.2f}] | 4/4 |" in section


def test_a_method_that_shares_no_run_does_not_leave_the_others_without_comparison(board, tmp_path):
    make_runs(tmp_path / "more", ["theirs"], ["courtyard"], ["storm-1"], size=(16, 16))
    publish(tmp_path / "more", board)
    table = collect(board)
    section = comparisons_text(table, collect_views(table, board)).split("## Suite development")[1]
    assert "| better | than |" in section
    assert "Not compared, since fewer than half of the runs are shared: theirs." in section


def test_tracks_are_compared_apart(board):
    table = collect(board).query("scene == 'courtyard'")
    views = collect_views(table, board)
    worse = views.assign(track="sparse-views", psnr=views.psnr - 5 * (views.method == "ours"))
    other = table.assign(track="sparse-views")
    both = (pd.concat(pair, ignore_index=True) for pair in ((table, other), (views, worse)))
    assert comparisons_text(*both).startswith(comparisons_text(table, views))


def test_runs_that_left_the_board_go_and_files_of_the_users_stay(board, shown, tmp_path):
    out = Path(shutil.copytree(shown, tmp_path / "out"))
    notes = out / "demo/ours/pond/streak-1/seed-0/notes.txt"
    notes.write_text("mine")
    shutil.rmtree(board / "demo" / "ours")
    write_board(board, out)
    assert set(collect(out).method) == {"3dgs", "3dgs-clean"}
    assert len(list((out / "site" / "runs").iterdir())) == 9
    assert [path.name for path in notes.parent.iterdir()] == ["notes.txt"]


def test_runs_of_a_board_that_cannot_be_used_are_named(board, tmp_path):
    damaged, partial = (board / "demo" / method / "pond/streak-1/seed-0/record.json" for method in ("3dgs", "ours"))
    damaged.write_text("{")
    edit(partial, status="partial", reason="no weights", lpips_vgg=None)
    told = r"cannot be shown[\s\S]*demo/3dgs/pond/.*not valid JSON[\s\S]*demo/ours/pond/.*: partial: no weights"
    with pytest.raises(InputError, match=told):
        write_board(board, tmp_path / "out")


def test_folders_that_are_something_else_are_refused(board, made, tmp_path):
    before = files(made)
    with pytest.raises(InputError, match="the board itself"):
        write_board(board, board)
    with pytest.raises(InputError, match="results: holds other files"):
        write_board(board, made / "results")
    assert files(made) == before
    with pytest.raises(InputError, match="no published run"):
        write_board(tmp_path / "nothing", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_tables_and_comparisons_of_the_board_that_ships_are_printed_and_nothing_is_written(board, capsys):
    before = files(board)
    table_command(board)
    printed = capsys.readouterr().out
    assert "pond (demo, given-poses, test suite)" in printed
    assert "all runs:" not in printed
    compare_command(results=board, suite="test")
    assert "Means over the 4 runs that all of them have, on 2 scenes" in capsys.readouterr().out
    with pytest.raises(InputError, match="leaderboard board"):
        site_command(board)
    assert files(board) == before
    assert len(run_folders(board)) == 15


def test_pages_are_read_before_anything_is_written(board, tmp_path):
    (tmp_path / "latin.md").write_bytes(b"\xe9")
    for name, message in (("absent.md", "No such file"), ("latin.md", "not text in UTF-8"), (".", "cannot be read")):
        with pytest.raises(InputError, match=message):
            write_board(board, tmp_path / "out", [tmp_path / name])
    assert not (tmp_path / "out").exists()


def test_the_command_fills_the_tables_of_pages_and_keeps_line_endings(board, tmp_path, capsys):
    page, table = tmp_path / "page.md", "| suite | rain | `ours` |\n|---|---|---|\n\n"
    text = f"Unix\n<!-- board: demo suites streak-1 -->\n\n{table}<!-- /board -->\n"
    page.write_bytes(text.encode() + text.replace("Unix", "DOS").replace("\n", "\r\n").encode())
    board_command(board, tmp_path / "out", (page,))
    assert capsys.readouterr().out == f"open {tmp_path / 'out/site/index.html'}\n"
    unix, dos = page.read_bytes().split(b"DOS\r\n")
    assert b"| test, 2 scenes | streak, medium | **" in unix
    assert dos == unix.removeprefix(b"Unix\n").replace(b"\n", b"\r\n")
