"""Renders of others: scored as ours are, and refused as a whole where anything is not as it has to be."""

import csv
import os
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import PIL.Image
import pytest
from damage import edit as edit_json
from finished_runs import finished_run

from baselines.method import METHODS
from hydroviews.cli.plugins import registered
from hydroviews.errors import InputError
from leaderboard.__main__ import submit_command
from leaderboard.records import UNREADABLE
from leaderboard.scoring.score import score
from leaderboard.scoring.submission import submit

ABOUT = """
method = "their-method"
authors = ["Ada", "Grace"]
link = "https://example.org/paper"
hardware = "one old card"
profile = "demo"

[[runs]]
scene = "yard"
pattern = "streak-0"
seconds = 12.5
data_sha256 = "{data_sha256}"
"""
OURS = registered(METHODS)["3dgs"]
VIEW = "yard/streak-0/seed-0/view-00.png"


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    """A run of our own: its folder, where it is, its record."""
    folder = tmp_path_factory.mktemp("ours")
    run = finished_run(folder)
    return folder, run, score(run)


@pytest.fixture
def theirs(ours, tmp_path):
    """The renders of our run as somebody would submit them, beside data and results."""
    folder, run, record = ours
    shutil.copytree(folder / "data", tmp_path / "data")
    submitted = tmp_path / "theirs"
    shutil.copytree(run.folder / "renders", submitted / "yard/streak-0/seed-0")
    (submitted / "submission.toml").write_text(ABOUT.format(data_sha256=record.data_sha256))
    return submitted


def sent(theirs: Path) -> None:
    submit_command(theirs, theirs.parent / "data", theirs.parent / "results")


@pytest.mark.parametrize("saved", [lambda text: text, lambda text: b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n")])
def test_our_own_renders_submitted_score_the_same_and_are_marked(theirs, ours, capsys, saved):
    """However editors save the file about them."""
    about = theirs / "submission.toml"
    about.write_bytes(saved(about.read_bytes()))
    sent(theirs)
    assert "| their-method (submitted) |" in capsys.readouterr().out
    results = theirs.parent / "results"
    row = pd.read_csv(results / "leaderboard.csv").iloc[0]
    scores = ours[2].scores
    assert row[list(scores)].to_dict() == pytest.approx(scores, abs=1e-6)
    assert (row.method, row.status, row.device, row.train_s) == ("their-method", "done", "one old card", 12.5)
    assert (row.submitted_by, row.link) == ("Ada, Grace", "https://example.org/paper")
    assert row.renders_sha256 == ours[2].renders_sha256
    assert row[["version", "model_mb", "render_fps"]].isna().all()


def test_what_they_write_of_themselves_is_run_by_no_spreadsheet_and_obeyed_by_no_page(theirs):
    about = theirs / "submission.toml"
    text = about.read_text().replace('"Ada"', """'=HYPERLINK("http://evil.example")'""")
    about.write_text(text.replace("one old card", "=1+1 | 80 GB"))
    sent(theirs)
    results = theirs.parent / "results"
    with (results / "leaderboard.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["submitted_by"] == '\'=HYPERLINK("http://evil.example"), Grace'
    assert row["device"] == "'=1+1 | 80 GB"
    for path in results.glob("*.csv"):
        cells = [cell for line in csv.reader(path.open(newline="")) for cell in line]
        assert not [cell for cell in cells if cell.startswith(("=", "+", "@"))], path
    costs = (results / "tables.md").read_text().partition("| costs ")[2].splitlines()
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in costs[1:3]}) == 1  # as many columns
    assert r"=1+1 \| 80 GB" in costs[2]


def test_submitted_again_it_is_kept_and_other_renders_are_refused_unless_overwritten(theirs, caplog):
    sent(theirs)
    stamp = theirs.parent / "results/demo/their-method/yard/streak-0/seed-0/renders/view-00.png"
    before = stamp.stat().st_mtime_ns
    sent(theirs)
    assert stamp.stat().st_mtime_ns == before
    paint(theirs / VIEW, np.zeros((36, 48, 3), np.uint8))
    with pytest.raises(InputError, match=r"holds another run of that name[\s\S]*--overwrite"):
        sent(theirs)
    (record,) = submit(theirs, theirs.parent / "data", theirs.parent / "results", overwrite=True)
    assert stamp.read_bytes() == (theirs / VIEW).read_bytes()
    assert record.status != UNREADABLE


def paint(path: Path, pixels: np.ndarray) -> None:
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def edit(theirs: Path, old: str, new: str) -> None:
    about = theirs / "submission.toml"
    assert old in about.read_text()
    about.write_text(about.read_text().replace(old, new))


def as_link(path: Path, target: Path) -> None:
    """To a file that is there, or to where what it stands for is moved."""
    if target.exists():
        path.unlink()
    else:
        shutil.move(path, target)
    os.symlink(target, path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: edit(t, '"yard"', '"garden"'), "scene garden.*no such scene"),
        (lambda t: edit(t, '"yard"', '"../yard"'), "no such scene"),
        (lambda t: edit(t, '"streak-0"', '"raindrop-1"'), "no such pattern"),
        (lambda t: edit(t, '"streak-0"', '"../clean"'), "no such pattern"),
        (lambda t: edit(t, "data_sha256 = ", 'data_sha256 = "' + 64 * "0" + '" #'), "trained on other data"),
        (lambda t: edit(t, "data_sha256 = ", 'data_sha256 = "short" #'), "data_sha256 'short'"),
        (lambda t: edit(t, "their-method", "3dgs"), "is one of ours"),
        (lambda t: edit(t, "their-method", "DeRainGS"), "is one of ours"),
        (lambda t: edit(t, "their-method", "rainy-poses"), "is one of ours"),
        (lambda t: edit(t, "their-method", OURS.replace(":", ".")), "is one of ours"),
        (lambda t: edit(t, "their-method", "../../x"), r"method '\.\./\.\./x'"),
        (lambda t: edit(t, "their-method", "<script>"), "method '<script>'"),
        (lambda t: edit(t, "https://", "javascript:"), "link 'javascript:"),
        (lambda t: edit(t, "https://example.org", "https://[abc"), r"link 'https://\[abc/paper'"),
        (lambda t: edit(t, "https://example.org", "https://"), "link 'https:///paper': value error, no host in it"),
        (lambda t: edit(t, '["Ada", "Grace"]', "[]"), r"authors \[\]"),
        (lambda t: edit(t, "hardware =", "colour ="), "no hardware; unknown colour"),
        (lambda t: edit(t, "12.5", "nan"), "runs.0.seconds nan"),
        (lambda t: edit(t, "[[runs]]", "[[runs"), "not valid TOML"),
        (lambda t: edit(t, "[[runs]]", "[[runs]]\nseed = -1"), "runs.0.seed -1"),
        (lambda t: edit(t, "profile = ", 'track = "my-poses"\nprofile = '), "track 'my-poses'"),
        (lambda t: (t / "submission.toml").unlink(), "cannot be read"),
        (lambda t: (t / VIEW).unlink(), "view-00.png: no render of this held-out view"),
        (lambda t: shutil.copy(t / VIEW, (t / VIEW).with_name("view-01.png")), "belong to no run[\\s\\S]*view-01.png"),
        (lambda t: (t / "setup.py").write_text("boom"), "belong to no run[\\s\\S]*setup.py"),
        (lambda t: paint(t / VIEW, np.zeros((36, 48, 3), np.uint16)), "16 bits, 3 channels"),
        (lambda t: paint(t / VIEW, np.zeros((36, 48, 4), np.uint8)), "8 bits, 4 channels"),
        (lambda t: paint(t / VIEW, np.zeros((36, 48), np.uint8)), "8 bits, 1 channels"),
        (lambda t: paint(t / VIEW, np.zeros((35, 48, 3), np.uint8)), "48x35 pixels"),
        (lambda t: PIL.Image.new("RGB", (48, 36)).save(t / VIEW, "JPEG"), "no PNG"),
        (lambda t: (t / VIEW).write_bytes((t / VIEW).read_bytes()[:-400]), "cannot be read as a render"),
        (lambda t: as_link(t / VIEW, t.parent / "data/demo/yard/clean/view-00.png"), "a link"),
        (lambda t: as_link(t / "yard/streak-0/seed-0", t.parent / "elsewhere"), "a link"),
    ],
)
def test_a_submission_that_is_not_as_it_has_to_be_is_refused_as_a_whole(theirs, change, message):
    change(theirs)
    with pytest.raises(InputError, match=message):
        sent(theirs)
    assert not (theirs.parent / "results").exists()


def test_a_run_of_ours_is_not_replaced(theirs, ours):
    run = theirs.parent / "results/demo/their-method/yard/streak-0/seed-0"
    shutil.copytree(ours[1].folder, run)
    edit_json(run / "config.json", method="their-method")
    with pytest.raises(InputError, match="holds another run of that name"):
        sent(theirs)
