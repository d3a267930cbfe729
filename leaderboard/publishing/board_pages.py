"""What a board of published runs shows: tables, comparisons and pages in a folder of their own."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import edit_bytes, write_bytes
from hydroviews.metrics import Metric, find_metrics
from leaderboard.gather import collect_views, run_folders, write_leaderboard
from leaderboard.publishing.board_tables import filled
from leaderboard.publishing.publish import publish
from leaderboard.site.pictures import SMALL, VIEWS_FOLDER
from leaderboard.site.write import write_site
from leaderboard.tables.comparison import compare, in_words
from leaderboard.tables.dataframes import suite_blocks
from leaderboard.tables.markdown import block_title, suite_title

COMPARISONS = "comparisons.md"


def write_board(board: Path, out: Path, pages: Sequence[Path] = (), docs: str = "") -> Path:
    """Write the runs of a board, all tables, comparisons and the pages into a folder that can be put on a web server.

    Args:
        board: published runs; nothing is written there.
        out: a new folder, or one that this function wrote; runs that are no longer on the board go.
        pages: Markdown files whose tables are filled from the runs.
        docs: address of the documentation, see `write_site`.

    Returns:
        The pages' index.

    Raises:
        InputError: no runs, or some that are partial or cannot be trusted; `out` is the board itself or holds other
            files; a page cannot be read (then nothing is written); or a table is not as it has to be.
    """
    texts = {page: _read_page(page) for page in pages}
    _copy_runs(board, out)
    table = write_leaderboard(out)
    views = collect_views(table, out)
    write_bytes(out / COMPARISONS, comparisons_text(table, views).encode())
    index = write_site(table, out, data=out, docs=docs)  # pictures are those of the board
    for page, text in {page: filled(text, table, views) for page, text in texts.items()}.items():
        edit_bytes(page, text.encode())
    return index


def _read_page(page: Path) -> str:
    """A page's text, with line endings as they are."""
    try:
        return page.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError(f"{page}: cannot be read", found=error.strerror, expected="a page of Markdown") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{page}: not text in UTF-8", found=error, expected="a page of Markdown") from None


def _copy_runs(board: Path, out: Path) -> None:
    if board.resolve() == out.resolve():
        raise InputError(f"{out}: the board itself", fix="choose another folder with --out")
    names = {folder.relative_to(board) for folder in run_folders(board)}
    if not names:
        raise InputError(f"{board}: no published run", fix="leaderboard publish --results FOLDER")
    ownership.claim_new(out)
    for folder in run_folders(out):
        if folder.relative_to(out) not in names:
            ownership.remove(folder)
    for path in (out / VIEWS_FOLDER).rglob(f"*{SMALL}"):
        if not (board / path.relative_to(out)).is_file():
            ownership.remove(path)
    left_out = publish(board, out, submitted=True, overwrite=True).left_out
    if left_out:
        raise InputError(
            f"{board}: runs that cannot be shown",
            found="; ".join(f"{name}: {reason}" for name, reason in left_out.items()),
            expected="runs as leaderboard publish writes them",
            fix="restore them, or remove their folders",
        )


def comparisons_text(table: pd.DataFrame, views: pd.DataFrame) -> str:
    """The methods of every profile, track and suite against each other, by every metric, as Markdown.

    Args:
        table: runs, as `gather.collect` has them.
        views: the scores of their views.
    """
    parts = []
    for (profile, track, suite), found in suite_blocks(table).items():
        own = views[(views.profile == profile) & (views.track == track) & (views.suite == suite)]
        for block in found:
            rows = table.loc[block.rows.index]
            where = suite_title(profile, track, suite)
            for metric in find_metrics() if (rows.pattern != CLEAN).any() else ():
                parts.append(_comparison_text(rows, own, metric, block_title(f"## {where}: {metric.title}", block)))
    return "\n".join(parts)


def _comparison_text(rows: pd.DataFrame, views: pd.DataFrame, metric: Metric, title: str) -> str:
    """A comparison under its title; where nothing can be compared, why."""
    try:
        return in_words(compare(rows, views, metric.name), title)
    except InputError as error:
        return f"{title}\n\n{error}\n"
