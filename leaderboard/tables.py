"""Records as tables people read: one a scene, methods down, effects across."""

from collections.abc import Hashable
from pathlib import Path

import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.suites import DEVELOPMENT, TEST, read_suite, suite_of
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import write_bytes
from hydroviews.formats.markdown import markdown_table
from hydroviews.metrics import find_metrics
from leaderboard.records import SCORED
from leaderboard.severity import CEILING, FLOOR

TABLES = "tables.md"


def scene_table(table: pd.DataFrame, scene: str, profile: str, track: str) -> pd.DataFrame:
    """One scene's means in one track, over patterns and seeds: a row a method, columns (effect, metric).

    The ceiling, trained once on clean views, stands under every effect. `gap` is the share of the way from
    floor to ceiling in PSNR (see `share_of_gap`); `runs` counts scored/all. A metric that one of the runs lacks is NaN.
    """
    rows = table[(table.scene == scene) & (table.profile == profile) & (table.track == track)]
    rows = rows.assign(method=shown_names(rows))
    effects = sorted(set(rows.effect) - {CLEAN}) or [CLEAN]
    blocks = {effect: _effect_block(rows[rows.effect.isin([effect, CLEAN])]) for effect in effects}
    joined = pd.concat(blocks, axis=1)
    order = sorted(joined.index, key=lambda m: (m != CEILING, m != FLOOR, m))
    return joined.loc[order]


def shown_names(rows: pd.DataFrame) -> pd.Series:
    """Methods as tables name them: what somebody submitted is marked."""
    return rows.method + rows.submitted_by.map(lambda by: " (submitted)" if by and pd.notna(by) else "")


def _effect_block(rows: pd.DataFrame) -> pd.DataFrame:
    done = rows[rows.status.isin(SCORED)]
    names = [metric.name for metric in find_metrics()]
    numbers = done.astype(dict.fromkeys(names, float)).groupby("method")[names].mean(skipna=False)
    block = numbers.reindex(sorted(set(rows.method)))
    block["gap"] = [share_of_gap(done, method) for method in block.index]
    block["train_s"] = done.groupby("method")["train_s"].mean().astype(float)
    counts = rows.groupby("method")["status"].agg(lambda s: f"{s.isin(SCORED).sum()}/{len(s)}")
    block["runs"] = counts
    return block


def share_of_gap(done: pd.DataFrame, method: str) -> float:
    """(PSNR - floor) / (ceiling - floor), means over the runs that have both references.

    A run's floor has its pattern, seed and data, its ceiling its seed. NaN where no run has both, or the
    ceiling is not above the floor.
    """
    same = ["pattern", "seed", "data_sha256"]
    floor = done[done.method == FLOOR][[*same, "psnr"]]
    ceiling = done[done.method == CEILING][["seed", "psnr"]]
    runs = done[done.method == method][[*same, "psnr"]]
    if method == CEILING:  # it stands for itself wherever there is a floor
        runs = floor[same].merge(ceiling, on="seed")
    runs = runs.merge(floor, on=same, suffixes=("", "_floor")).merge(ceiling, on="seed", suffixes=("", "_ceiling"))
    means = runs[["psnr", "psnr_floor", "psnr_ceiling"]].astype(float).mean()
    gap = means["psnr_ceiling"] - means["psnr_floor"]
    return float((means["psnr"] - means["psnr_floor"]) / gap) if gap > 0 else float("nan")


def to_markdown(table: pd.DataFrame) -> str:
    """A scene's table as Markdown, the effects one below the other."""
    titles = [metric.title for metric in find_metrics()]
    parts = []
    for effect in dict.fromkeys(table.columns.get_level_values(0)):
        head = (effect, *titles, "share of gap", "train s", "runs")
        parts.append(markdown_table(head, map(_cells, table[effect].iterrows()), keep_empty=True))
    return "\n\n".join(parts) + "\n"


def _cells(row: tuple[Hashable, pd.Series]) -> list[str]:
    """A method's, empty where there is no number."""
    method, values = row
    scores = ["" if pd.isna(values[metric.name]) else metric.text(values[metric.name]) for metric in find_metrics()]
    seconds = "" if pd.isna(values["train_s"]) else f"{values['train_s']:.0f}"
    return [str(method), *scores, _percent(values["gap"]), seconds, "" if pd.isna(values["runs"]) else values["runs"]]


def _percent(value: float) -> str:
    return "" if pd.isna(value) else f"{100 * value:.0f} %"


def scene_text(table: pd.DataFrame, scene: str, profile: str, track: str) -> str:
    """One scene's table under its name, to be printed."""
    suite = f", {suite_of(scene)} suite" if suite_of(scene) else ""
    return f"{scene} ({profile}, {track}{suite})\n\n{to_markdown(scene_table(table, scene, profile, track))}"


def legend() -> str:
    """Which numbers of the tables should be high and which low."""
    ways = {True: "higher", False: "lower"}
    titles = {way: [m.title for m in find_metrics() if m.higher_is_better == way] for way in ways}
    return "; ".join(f"{', '.join(titles[way])}: {word} is better" for way, word in ways.items() if titles[way])


def scene_keys(table: pd.DataFrame) -> list[tuple[str, str, str]]:
    """Scene, profile and track of every table there is, sorted by profile, suite (TEST first), scene and track."""
    keys = {(str(row.scene), str(row.profile), str(row.track)) for row in table.itertuples()}
    places = {TEST: 0, DEVELOPMENT: 1, "": 2}
    return sorted(keys, key=lambda key: (key[1], places[suite_of(key[0])], key[0], key[2]))


def of_suite(table: pd.DataFrame, suite: str) -> pd.DataFrame:
    """The rows of a suite's scenes; all for an empty name.

    Raises:
        InputError: no such suite, or no row of it.
    """
    if not suite:
        return table
    if suite not in (TEST, DEVELOPMENT):
        raise unknown_name(f"SUITE={suite}", suite, "suite", (TEST, DEVELOPMENT))
    rows = table[table.scene.map(suite_of) == suite]
    if rows.empty:
        raise InputError(f"no run on a scene of the suite {suite}", expected=", ".join(read_suite(suite).scenes))
    return rows


def write_tables(table: pd.DataFrame, results: Path) -> None:
    """Write `tables.md`: every scene of every profile, a table a track."""
    parts = [f"## {scene_text(table, *keys)}" for keys in scene_keys(table)]
    write_bytes(results / TABLES, "\n".join([*parts, legend() + "\n"]).encode())
