"""Tables on pages of Markdown that are filled from the records of a board.

    <!-- board: demo suites raindrop-1 streak-1 -->

    | suite | rain | `3dgs-clean`, the ceiling | [`deraings`](deraings.md) | `3dgs` |
    |---|---|---|---|---|

    <!-- /board -->

The first comment names the profile, what has rows (suites or scenes), and patterns, a row each. The head is the page's
own: two columns of names, then a method a column, in backticks. Rows are written anew, and a sentence on what they are.
"""

import math
import re
from collections.abc import Iterator, Sequence

import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.suites import DEVELOPMENT, TEST, suite_of
from hydroviews.errors import InputError, unknown_name
from hydroviews.formats.markdown import markdown_table
from hydroviews.metrics import find_metrics
from leaderboard.comparison import differences, scene_scores
from leaderboard.means import RUN, Compared, compared_runs, method_means, shown_names
from leaderboard.records import GIVEN_POSES, effect_of
from leaderboard.severity import CEILING, FLOOR
from leaderboard.statistics import estimate
from leaderboard.table_text import score_cells
from leaderboard.tables import grade_of, share_of_gap

START, END = "<!-- board: ", "<!-- /board -->"
BLOCK = re.compile(rf"{START}(\S+) (suites|scenes) (\S+(?: \S+)*) -->\s*\n(.*?){END}", re.DOTALL)
METHOD = re.compile(r"`([^`]+)`")
SUITES_LEGEND = f"PSNR, means over scenes; in brackets above `{FLOOR}`, ± half a 95 % interval for scenes like these."
SCENES_LEGEND = f"PSNR; in brackets the share of the gap between `{FLOOR}` and `{CEILING}`."


def filled(text: str, table: pd.DataFrame, views: pd.DataFrame) -> str:
    """A page with its tables written anew.

    Args:
        text: the page.
        table: runs, as `gather.collect` has them.
        views: the scores of their views, as `gather.collect_views` has them.

    Raises:
        InputError: a table is not as it has to be, or there are no such runs.
    """
    if not len(BLOCK.findall(text)) == text.count(START) == text.count(END):
        raise InputError(
            "a table of the board is not as it has to be",
            found=", ".join(line for line in text.splitlines() if line.startswith((START, END))),
            expected=f"{START}PROFILE suites|scenes PATTERN ... -->, a table, and {END}",
        )
    rows, views = (_given(one.assign(method=shown_names(one))) for one in (table, views))
    return BLOCK.sub(lambda block: _block(block, rows, views), text)


def _given(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows.track == GIVEN_POSES]


def _block(block: re.Match, rows: pd.DataFrame, views: pd.DataFrame) -> str:
    profile, kind, patterns, body = block.groups()
    start = block[0].splitlines()[0]
    head, methods = _head(start, body)
    rows, views = (one[one.profile == profile] for one in (rows, views))
    known = sorted(set(rows.method))
    for method in methods:
        if method not in known:
            raise unknown_name(f"{method} in {start}", method, "method with runs", known)
    rows, views = (one[one.method.isin(methods)] for one in (rows, views))
    of_suites, names = kind == "suites", patterns.split(" ")
    lines = list(_suite_rows(rows, views, names) if of_suites else _scene_rows(rows, names))
    if not lines:
        raise InputError(f"{start}: no such run", expected=f"{', '.join(methods)} under {patterns}")
    body = markdown_table(
        head, [[*line, *(cells.get(method, "") for method in methods)] for line, cells in lines], True
    )
    return f"{start}\n\n{body}\n\n{SUITES_LEGEND if of_suites else SCENES_LEGEND} {_basis(rows, names)}\n\n{END}"


def _head(start: str, body: str) -> tuple[list[str], list[str]]:
    """The cells of a table's head, and the methods that it names."""
    line = body.lstrip().partition("\n")[0].strip()
    head = [cell.strip() for cell in line.removeprefix("|").removesuffix("|").split("|")]
    methods = [found[1] for cell in head[2:] if (found := METHOD.search(cell))]
    if not methods or len(methods) != len(head) - 2:
        raise InputError(f"{start}: a head without methods", found=line, expected=f"as in | suite | rain | `{FLOOR}` |")
    return head, methods


def _basis(rows: pd.DataFrame, patterns: Sequence[str]) -> str:
    """Which runs a table is of."""
    own = rows[rows.pattern.isin([*patterns, CLEAN]) & (rows.scene.map(suite_of) != "")]
    seeds, versions = (sorted(map(str, set(own[name]))) for name in ("seed", "version"))
    return (
        f"Profile `{own.profile.iloc[0]}`, seed{'s' * (len(seeds) > 1)} {', '.join(seeds)}, code {', '.join(versions)}."
    )


Row = tuple[list[str], dict[str, str]]  # names, cells by method


def _suite_rows(rows: pd.DataFrame, views: pd.DataFrame, patterns: Sequence[str]) -> Iterator[Row]:
    """PSNR as means over the scenes of a suite, and what is gained over the floor with its 95 % interval."""
    for suite in (TEST, DEVELOPMENT):
        for pattern in patterns:
            own = _under(rows[rows.scene.map(suite_of) == suite], pattern)
            found = compared_runs(own)
            if not found.runs:
                continue
            gains = _gains(views, found, pattern)
            scores = _scores(own, found.rows)
            scenes = len({scene for scene, *_ in found.runs})
            names = [f"{suite}, {scenes} scene{'' if scenes == 1 else 's'}", _told(pattern)]
            yield names, {method: f"{score}{gains.get(method, '')}" for method, score in scores.items()}


def _scene_rows(rows: pd.DataFrame, patterns: Sequence[str]) -> Iterator[Row]:
    """PSNR of a scene, and the share of the gap between floor and ceiling."""
    for suite in (TEST, DEVELOPMENT):
        for scene in sorted(name for name in set(rows.scene) if suite_of(name) == suite):
            for pattern in patterns:
                own = _under(rows[rows.scene == scene], pattern)
                found = compared_runs(own)
                if not found.runs:
                    continue
                scores = _scores(own, found.rows)
                shares = {name: share_of_gap(found.rows, name) for name in scores if name not in (CEILING, FLOOR)}
                told = {name: f" ({100 * share:.0f} %)" for name, share in shares.items() if not math.isnan(share)}
                names = [scene if suite == TEST else f"{scene} ({suite})", _told(pattern)]
                yield names, {method: f"{score}{told.get(method, '')}" for method, score in scores.items()}


def _under(rows: pd.DataFrame, pattern: str) -> pd.DataFrame:
    return rows[rows.pattern.isin([pattern, CLEAN])]


def _told(pattern: str) -> str:
    return ", ".join(filter(None, (effect_of(pattern), grade_of(pattern))))


def _scores(rows: pd.DataFrame, kept: pd.DataFrame) -> dict[str, str]:
    cells = score_cells(method_means(rows, kept), find_metrics()[0])
    return {str(method): cell for method, cell in cells.items() if cell}


def _gains(views: pd.DataFrame, compared: Compared, pattern: str) -> dict[str, str]:
    """PSNR above the floor with half its interval, by method; the ceiling's as if it had been run under the pattern."""
    runs = compared.rows[compared.rows.pattern == pattern]
    clean = views[views.method.eq(CEILING)].drop(columns=["pattern", "data_sha256"])
    clean = clean.merge(runs[RUN].drop_duplicates(), on=["scene", "seed"])
    own = pd.concat([views[views.pattern == pattern], clean], ignore_index=True)
    names = [name for name in sorted(compared.methods) if name != FLOOR]
    names += [CEILING] if len(clean[RUN].drop_duplicates()) == len(compared.runs) else []
    if FLOOR not in compared.methods or not names:
        return {}
    scenes = scene_scores(own, "psnr", [FLOOR, *names], compared.runs)
    found = estimate(differences(scenes, [(i, 0) for i in range(1, len(names) + 1)]))
    halves = (found.high - found.low) / 2
    return {
        name: f" ({gain:+.2f})" if math.isnan(half) else f" ({gain:+.2f} ± {half:.2f})"
        for name, gain, half in zip(names, found.mean, halves, strict=True)
    }
