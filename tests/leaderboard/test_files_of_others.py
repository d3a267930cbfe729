"""No command removes or overwrites a file of somebody else's: each is tried with such files wherever it writes."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from damage import files
from finished_runs import finished_run
from made_up_board import write_board

from baselines.rendering.film import FilmChoice, write_film
from hydroviews.__main__ import build_command, download_command, pack_command, sheet_command, video_command
from hydroviews.errors import InputError
from hydroviews.scene.images import write_png
from leaderboard import __main__ as board
from leaderboard.contract import check as contract
from leaderboard.runs.run import Run
from leaderboard.sweep import sweep as sweeps
from leaderboard.sweep.sweep import SweepRequest

RUN = "results/demo/finished_runs.Cloud/yard/streak-0/seed-0"
ATTENTION = "baselines.derain_nerf.raindrop_attention"
PROGRAMS = ("hydroviews", "leaderboard", "deraings.enhancement", ATTENTION)

# Each command in a folder that has what `made` made; it writes below that folder.
TRIED: dict[str, Callable[[Path], object]] = {
    "hydroviews build": lambda f: build_command(str(f / "yard"), out=f / "built", patterns=("streak-0",)),
    "hydroviews sheet": lambda f: sheet_command(f / "data/demo", out=f / "sheets"),
    "hydroviews pack": lambda f: pack_command(f / "data/demo", f / "packed", i_have_the_rights="CC0-1.0"),
    "hydroviews download": lambda f: download_command(str(f / "archives/yard-streak-0.zip"), out=f / "fetched"),
    "hydroviews video": lambda f: video_command(f / "walk.mp4", f / "walk", rate=2.0, frames_only=True),
    "leaderboard sweep": lambda f: board.sweep_command(
        SweepRequest(methods=("3dgs",), results=f / "swept", slurm=f / "swept/jobs.sh")
    ),
    "leaderboard check": lambda f: board.check_command("3dgs", json=f / "checked.json"),
    "leaderboard table": lambda f: board.table_command(f / "scored"),
    "leaderboard site": lambda f: board.site_command(f / "scored", f / "nowhere"),
    "leaderboard publish": lambda f: board.publish_command(f / "scored", f / "board"),
    "leaderboard board": lambda f: board.board_command(f / "published", f / "shown"),
    "leaderboard film": lambda f: board.film_command(f / RUN, FilmChoice(0.2, 10, 16), f / "film.mp4", f / "data"),
    "leaderboard export": lambda f: board.export_command(f / RUN, f / "splats.ply"),
}

# Commands that take long or share a function are tried in tests of their own, where the same is asked of them.
ELSEWHERE = {
    "hydroviews eval",  # test_evaluate.py
    "leaderboard score",
    "leaderboard submit",  # files/test_settings_guard.py
    "hydroviews reconstruct",
    "hydroviews poses",  # sfm/test_poses.py
    "deraings.enhancement average",  # enhancement/test_commands.py
    "deraings.enhancement train",
    "deraings.enhancement export",
    "deraings.enhancement validate",
    f"{ATTENTION} train",
    f"{ATTENTION} export",
    "deraings.enhancement enhance",  # captures/test_single_pictures.py
    f"{ATTENTION} detect",  # files/test_ownership.py
}

READING = {
    "hydroviews doctor",
    "hydroviews verify",
    "leaderboard methods",
    "leaderboard compare",
    "leaderboard view",
    "deraings.enhancement describe",
    f"{ATTENTION} validate",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A built capture and a run on it, packed; scored runs, published; a film."""
    folder = tmp_path_factory.mktemp("made")
    finished_run(folder)
    pack_command(folder / "data/demo", folder / "archives", i_have_the_rights="CC0-1.0")
    write_board(folder / "scored", ("3dgs", "3dgs-clean"), ("pond",), ("streak-1",), size=(16, 16))
    board.publish_command(folder / "scored", folder / "published")
    rng = np.random.default_rng(0)
    for index in range(8):
        write_png(folder / "frames" / f"{index:05d}.png", rng.integers(0, 256, (32, 48, 3)).astype(np.uint8))
    write_film(folder / "walk.mp4", folder / "frames", 8, 2)
    return folder


@pytest.fixture
def given(made, tmp_path, monkeypatch):
    """Makes a copy of that under a name."""
    monkeypatch.setattr(contract, "run_checks", lambda *_: [])
    runs = [Run("3dgs", "demo", 0, Path(), "yard", "clean", tmp_path / "r")]
    monkeypatch.setattr(sweeps, "build_runs", lambda *_: runs)
    return lambda name: Path(shutil.copytree(made, tmp_path / name, symlinks=True))


@pytest.mark.parametrize("command", TRIED)
def test_nothing_of_the_users_is_lost(command, given):
    before = given("inputs")
    there = files(before)
    TRIED[command](before)
    written = files(before).keys() - there.keys()
    assert written
    TRIED[command](before)  # what it wrote itself is no obstacle
    assert not [name for name in files(before) if name.endswith(".kept")]

    folder, mine = given("mine"), {}
    for name in sorted(written):
        for path in (folder / name, (folder / name).with_name("notes.txt")):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"mine: {path.relative_to(folder)}")
            mine[str(path.relative_to(folder))] = path.read_bytes()
    with suppress(InputError):
        TRIED[command](folder)
    left = set(files(folder).values())
    assert {name for name, content in mine.items() if content not in left} == set()


def registered(monkeypatch, program: str) -> set[str]:
    module = import_module(f"{program}.__main__")
    found: list[dict[str, object]] = []
    monkeypatch.setattr(module, "run_command", lambda commands, **_: found.append(commands))
    module.main()
    return {f"{program} {name}" for name in found[0]}


def test_every_command_is_tried(monkeypatch):
    commands = {command for program in PROGRAMS for command in registered(monkeypatch, program)}
    assert commands == TRIED.keys() | READING | ELSEWHERE
