import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import PATIENCE

from hydroviews.files.locks import locked_if_free
from hydroviews.files.temporary import remove_leftovers, remove_leftovers_in


def test_leftovers_are_removed_and_all_else_stays(tmp_path):
    folder = tmp_path / "scene [1]"
    (folder / "images").mkdir(parents=True)
    doomed = [
        folder / "images" / ".partial-host-0123-a.png",
        folder / ".partial-host-0123-sparse",
        tmp_path / f".partial-host-0123-{folder.name}",
        folder / ".lock-.partial-host-4567-a.png",  # of a process killed between its lock and its file
    ]
    kept = [folder / ".unfinished-mapping", folder / "images" / "c.png", tmp_path / ".partial-host-0123-another scene"]
    for path in [doomed[0], doomed[3], kept[1]]:
        path.write_text("half")
    for path in [*doomed[1:3], kept[0], kept[2]]:
        path.mkdir()
        (path / "file").write_text("half")
    remove_leftovers(folder)
    assert {path for path in tmp_path.rglob("*") if path.name != "file"} == {folder, folder / "images", *kept}


def test_leftovers_in_a_folder_go_and_those_below_it_stay(tmp_path):
    for folder in (tmp_path, tmp_path / "run"):
        folder.mkdir(exist_ok=True)
        for name in (".partial-host-0123-a.csv", ".lock-.partial-host-0123-a.csv", ".lock-a.csv", "a.csv"):
            (folder / name).write_text("1")
    remove_leftovers_in(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock-a.csv", "a.csv", "run"]
    assert len(list((tmp_path / "run").iterdir())) == 4


WRITER = """
import os, sys, time
from pathlib import Path
os.getpid = lambda: int(sys.argv[2])  # as in another container, where numbers mean nothing here
from hydroviews.files.atomic import replacing
with replacing(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print("half", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def writer(tmp_path):
    """A process that is in the middle of writing `a.txt`, with a number that no process has here."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait(PATIENCE)
    command = [sys.executable, "-c", WRITER, str(tmp_path / "a.txt"), str(ended.pid)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "half\n"
    yield process
    process.kill()
    process.wait(PATIENCE)


def test_what_is_being_written_stays_until_its_process_is_killed(tmp_path, writer):
    for half in (tmp_path, tmp_path / "a.txt"):
        remove_leftovers(half)
        assert [path.read_text() for path in tmp_path.glob(".partial-*")] == ["half"]
    writer.kill()
    writer.wait(PATIENCE)
    remove_leftovers(tmp_path)
    assert not list(tmp_path.iterdir())


def test_another_process_may_remove_leftovers_at_the_same_time(tmp_path):
    leftover = tmp_path / ".partial-host-0123-a.txt"
    leftover.write_text("half")
    with locked_if_free(leftover):
        remove_leftovers(tmp_path)
    assert leftover.exists()


def test_a_folder_that_another_process_removes_meanwhile_is_passed_over(tmp_path, monkeypatch):
    gone, leftover = tmp_path / "a" / "gone", tmp_path / "b" / ".partial-host-0123-a.txt"
    for folder in (gone, leftover.parent):
        folder.mkdir(parents=True)
    leftover.write_text("half")
    scandir = os.scandir

    def removing(path):
        if Path(path) == gone and gone.exists():
            gone.rmdir()
        return scandir(path)

    monkeypatch.setattr(os, "scandir", removing)
    remove_leftovers(tmp_path)
    assert not gone.exists()
    assert not leftover.exists()
