"""The board that ships: what is on it belongs there, and the tables on our pages are its own."""

import re
from pathlib import Path

import pytest
from damage import files

from leaderboard.gather import BOARD, collect, collect_views, run_folders
from leaderboard.publishing.board_tables import START, filled
from leaderboard.publishing.publish import publish

ROOT = Path(__file__).parents[3]
PAGES = re.search(r"^BOARD_PAGES := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[1].split()
published = pytest.mark.skipif(not run_folders(BOARD), reason="nothing is published yet: leaderboard publish")


@published
def test_every_run_on_it_can_be_published(tmp_path):
    """Done or failed, trusted, of committed code and this schema, and of one data set a variant."""
    outcome = publish(BOARD, tmp_path, submitted=True)
    assert (len(outcome.written), outcome.left_out) == (len(run_folders(BOARD)), {})
    assert set(files(BOARD)) == {"README.md", *files(tmp_path)}


@pytest.fixture(scope="module")
def runs_and_views():
    table = collect(BOARD)
    return table, collect_views(table, BOARD)


@published
@pytest.mark.parametrize("page", PAGES)
def test_its_tables_on_our_pages_are_up_to_date(page, runs_and_views):
    text = (ROOT / page).read_text()
    assert filled(text, *runs_and_views) == text, "make board writes them anew"


def test_make_board_fills_every_page_that_has_such_tables():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    assert sorted(str(page.relative_to(ROOT)) for page in pages if START in page.read_text()) == sorted(PAGES)
