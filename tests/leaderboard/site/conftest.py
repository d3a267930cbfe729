"""A small board whose names try to break its pages."""

import dataclasses

import pytest
from made_up_board import write_board as make_runs

from leaderboard.gather import write_leaderboard
from leaderboard.publishing.board_pages import write_board
from leaderboard.publishing.publish import publish
from leaderboard.records import Record, read_record, run_folder, write_record
from leaderboard.site.write import write_site

NASTY = "<img src=x onerror=alert(1)>\"'& </script><script>alert(2)<"  # a method's name
METHODS = ("3dgs", "3dgs-clean", "deraings", NASTY.replace("/", "\\"))


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """The results folder of a board with its pages: four methods, one submitted, and a failed run."""
    results = tmp_path_factory.mktemp("board")
    make_runs(results, METHODS, ("pond", "mipnerf360_bonsai"), ("raindrop-0", "streak-1"), n_views=4, size=(64, 48))
    failed = run_folder(results, "demo", "nerf-w", "pond", "streak-1", 0, "given-poses")
    failed.mkdir(parents=True)
    names = {"method": "nerf-w", "scene": "pond", "effect": "streak", "pattern": "streak-1", "seed": 0}
    sizes = {"n_train": 3, "n_test": 4, "width": 64, "height": 48}
    reason = "</td></script><script>alert(3)</script>"
    run = {"track": "given-poses", "profile": "demo", "data_sha256": "pond streak-1"}
    record = Record(**names, **sizes, **run, status="failed", reason=reason)
    write_record(failed, record)
    for scene, link in (("pond", "javascript:alert(4)"), ("mipnerf360_bonsai", "https://example.org/a?b=1&c=2")):
        folder = run_folder(results, "demo", METHODS[3], scene, "raindrop-0", 0, "given-poses")
        theirs = dataclasses.replace(read_record(folder / "record.json"), submitted_by="<b>Ada</b>", link=link)
        write_record(folder, theirs)
    write_site(write_leaderboard(results), results, results / "no data")
    return results


@pytest.fixture(scope="session")
def shipped(written, tmp_path_factory):
    """What a board of the runs shows: renders of the scene that the project draws."""
    board, out = tmp_path_factory.mktemp("shipped"), tmp_path_factory.mktemp("shown")
    publish(written, board, submitted=True)
    write_board(board, out)
    return out
