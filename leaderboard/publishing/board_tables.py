"""Tables on pages of Markdown that are filled from the records of a board.

    <!-- board: demo suites raindrop-1 streak-1 -->

    | suite | rain | `3dgs-clean`, the ceiling | [`deraings`](deraings.md) | `3dgs` |
    |---|---|---|---|---|

    <!-- /board -->

The first comment names the profile, what has rows (suites, scenes or methods), and patterns. The head is the page's.
Suites and scenes have a row for each pattern: two columns of names, then a method a column, in backticks. Methods have
a row each: a scene a column, in backticks, with the scores under all patterns in a cell; last, if wanted, `seconds`;
over the seeds that every method with runs on that scene and pattern has. Rows are written anew, and a sentence on what
they are.
"""

import math
import re
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.suites import DEVELOPMENT, TEST, suite_of
from hydroviews.errors import InputError, unknown_name
from hydroviews.formats.tables.markdown import Markup, markdown_table
from hydroviews.metrics import find_metrics
from hydroviews.profiles import find_profile
from leaderboard.records import CEILING, FLOOR, GIVEN_POSES, SCORED, effect_of
from leaderboard.tables.comparison import differences, scene_scores
from leaderboard.tables.dataframes import grade_of, share_of_gap
from leaderboard.tables.markdown import score_cells
from leaderboard.tables.means import RUN, Compared, compared_runs, method_means, shown_names
from leaderboard.tables.statistics import LEAST_SCENES, estimate

START, END = "<!-- board: ", "<!-- /board -->"
BLOCK = re.compile(rf"{START}(\S+) (suites|scenes|methods) (\S+(?: \S+)*) -->\s*\n(.*?){END}", re.DOTALL)
NAME = re.compile(r"`([^`]+)`")
SUITES_LEGEND = (
    f"PSNR in dB, mean over scenes. Brackets: gain over `{FLOOR}` ± half the width of its 95 % confidence interval "
    f"over scenes, from {LEAST_SCENES} scenes on."
)
SCENES_LEGEND = f"PSNR in dB. Brackets: share of the gap between `{FLOOR}` and `{CEILING}`."
SECONDS = "seconds"  # the head of a last column of costs

Row = tuple[list[str], dict[str, str]]  # names, cells by method
Filled = tuple[list[list[str]], str]  # rows, and what they are


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
            expected=f"{START}PROFILE suites|scenes|methods PATTERN ... -->, a table, and {END}",
        )
    rows, views = (_given(one.assign(method=shown_names(one))) for one in (table, views))
    return BLOCK.sub(lambda block: _as_ended(_block(block, rows, views), block[0]), text)


def _as_ended(text: str, before: str) -> str:
    """The text with the line endings of what it replaces."""
    return text.replace("\n", "\r\n") if "\r\n" in before else text


def _given(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows.track == GIVEN_POSES]


def _block(block: re.Match, rows: pd.DataFrame, views: pd.DataFrame) -> str:
    profile, kind, patterns, body = block.groups()
    start, names, head = block[0].splitlines()[0], patterns.split(" "), _head(body)
    rows, views = (one[one.profile == profile] for one in (rows, views))
    if kind == "methods":
        lines, legend = _of_methods(start, head, rows, names)
    else:
        lines, legend = _of_places(start, head, rows, views, names, kind == "suites")
    marked = [[Markup(cell) for cell in line] for line in lines]
    return f"{start}\n\n{markdown_table(head, marked, True)}\n\n{legend}\n\n{END}"


def _of_places(
    start: str, head: Sequence[str], rows: pd.DataFrame, views: pd.DataFrame, patterns: Sequence[str], suites: bool
) -> Filled:
    """Rows of suites or scenes, a method a column."""
    methods = _named(start, head[2:], "method", rows.method, f"| suite | rain | `{FLOOR}` |")
    rows, views = (one[one.method.isin(methods)] for one in (rows, views))
    found = list(_suite_rows(rows, views, patterns) if suites else _scene_rows(rows, patterns))
    if not found:
        raise InputError(f"{start}: no such run", expected=f"{', '.join(methods)} under {', '.join(patterns)}")
    lines = [[*names, *(cells.get(method, "") for method in methods)] for names, cells in found]
    shown = rows[rows.scene.map(suite_of) != ""]
    return lines, f"{SUITES_LEGEND if suites else SCENES_LEGEND} {_basis(shown, patterns)}"


def _of_methods(start: str, head: Sequence[str], rows: pd.DataFrame, patterns: Sequence[str]) -> Filled:
    """Rows of methods, a scene a column."""
    with_seconds = head[-1] == SECONDS
    scenes = _named(start, head[1 : len(head) - with_seconds], "scene", rows.scene, "| method | `room` | `pond` |")
    rows = rows[rows.scene.isin(scenes) & rows.pattern.isin([*patterns, CLEAN]) & rows.status.isin(SCORED)]
    rows = _of_shared_seeds(rows)
    asked = list(product(scenes, patterns))
    clean = [(scene, CLEAN) for scene in scenes]
    scores = rows.pivot_table(index="method", columns=["scene", "pattern"], values="psnr")
    scores = scores.reindex(columns=[*asked, *clean])
    if scores[asked].isna().all(axis=None):
        raise InputError(f"{start}: no such run", expected=f"{', '.join(scenes)} under {', '.join(patterns)}")
    best = scores[asked].max()
    seconds = (rows.train_s + rows.before_s.fillna(0) + rows.after_s.fillna(0)).groupby(rows.method).mean()
    lines = []
    for method in _ranked(scores, asked):
        cells = [_scene_cell(scores.loc[method][scene], best[scene], patterns) for scene in scenes]
        lines.append([f"`{method}`", *cells, *([_seconds_cell(seconds[method])] if with_seconds else [])])
    costs = " Seconds: mean over runs, before, in and after training." if with_seconds else ""
    legend = f"PSNR in dB under {', '.join(patterns)}.{costs}"
    return lines, f"{legend} {_basis(rows, patterns)}"


def _of_shared_seeds(rows: pd.DataFrame) -> pd.DataFrame:
    """The runs with seeds that every method with runs on the same scene and pattern has.

    Of those on clean views the ones with a seed that is left of their scene.
    """
    n_methods, n_having = (
        rows.groupby(keys).method.transform("nunique") for keys in (["scene", "pattern"], ["scene", "pattern", "seed"])
    )
    shared = rows[n_having == n_methods]
    clean = shared.pattern == CLEAN
    left = pd.MultiIndex.from_frame(shared.loc[~clean, ["scene", "seed"]])
    return shared[~clean | pd.MultiIndex.from_frame(shared[["scene", "seed"]]).isin(left)]


def _seconds_cell(seconds: float) -> str:
    """Empty where nobody said how long it took, as of runs that were submitted."""
    return "" if math.isnan(seconds) else f"{seconds:.0f}"


def _scene_cell(scores: pd.Series, best: pd.Series, patterns: Sequence[str]) -> str:
    """A method's scores on a scene, one a pattern; the one of a method that learns from clean views alone."""
    values = {pattern: scores[pattern] for pattern in (*patterns, CLEAN)}
    texts = {name: "" if math.isnan(value) else f"{value:.2f}" for name, value in values.items()}
    if texts.pop(CLEAN):
        return f"{values[CLEAN]:.2f}"
    if not any(texts.values()):
        return ""
    return ", ".join(f"**{text}**" if values[name] == best[name] else text or "-" for name, text in texts.items())


def _ranked(scores: pd.DataFrame, asked: Sequence[tuple[str, str]]) -> list[str]:
    """Methods with scores: references, then all that lack nothing by their mean, then by how much they lack."""
    own = scores[list(asked)]
    lacking, mean = own.isna().sum(axis=1), own.mean(axis=1)
    reference = lacking == len(asked)
    order = pd.DataFrame({"lacking": lacking.where(~reference, -1), "mean": -mean, "name": scores.index.astype(str)})
    return list(order.sort_values(["lacking", "mean", "name"]).index)


def _head(body: str) -> list[str]:
    """The cells of a table's head."""
    line = body.lstrip().partition("\n")[0].strip()
    return [cell.strip() for cell in line.removeprefix("|").removesuffix("|").split("|")]


def _named(start: str, cells: Sequence[str], kind: str, known: pd.Series, form: str) -> list[str]:
    """What each cell of a head names in backticks."""
    names = [found[1] for cell in cells if (found := NAME.search(cell))]
    if not names or len(names) != len(cells):
        raise InputError(f"{start}: a head without {kind}s", found=" | ".join(cells), expected=f"as in {form}")
    for name in names:
        if name not in set(known):
            raise unknown_name(f"{name} in {start}", name, f"{kind} with runs", sorted(set(known)))
    return names


def _basis(rows: pd.DataFrame, patterns: Sequence[str]) -> str:
    """Which runs a table is of; of those on clean views the ones that others are compared with."""
    rainy = rows[rows.pattern.isin(patterns)]
    own = pd.concat([rainy, rows[rows.pattern.eq(CLEAN) & rows.seed.isin(rainy.seed)]])
    seeds = sorted(map(str, set(own.seed)))
    profile = find_profile(own.profile.iloc[0])
    return (
        f"Profile `{profile.name}` (longer side at most {profile.long_side} pixels), "
        f"seed{'s' * (len(seeds) > 1)} {', '.join(seeds)}. The record of each run names its code."
    )


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
    halves = (found.high - found.low) / 2 if len(scenes) >= LEAST_SCENES else np.full(len(names), math.nan)
    return {
        name: f" ({gain:+.2f})" if math.isnan(half) else f" ({gain:+.2f} ± {half:.2f})"
        for name, gain, half in zip(names, found.mean, halves, strict=True)
    }
