"""Records as tables of numbers: scenes, severity grades, costs, ablations."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Literal

import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.suites import DEVELOPMENT, TEST, read_suite, suite_of
from hydroviews.errors import InputError, unknown_name
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.rain.patterns import GRADES
from leaderboard.records import CEILING, FLOOR
from leaderboard.tables.means import COSTS, Block, blocks, compared_runs, method_means, shown_names
from leaderboard.tables.paper_numbers import ABLATION, IN_CSV, beside_ours, published_ablation

SUITES = (TEST, DEVELOPMENT, "")  # in the order of tables; empty: scenes of no suite
SCORE = ("method", "pattern", "seed", "data_sha256", "psnr")
ABLATED = ("raindrop", "streak")  # effects of the paper's ablation


def scene_table(table: pd.DataFrame, scene: str, profile: str, track: str) -> pd.DataFrame:
    """The first of `scene_tables`."""
    return scene_tables(table, scene, profile, track)[0]


def scene_tables(table: pd.DataFrame, scene: str, profile: str, track: str) -> list[pd.DataFrame]:
    """One scene's means in one track, over patterns and seeds: a row a method, columns (effect, number).

    The ceiling, trained once on clean views, stands under every effect. The numbers are those of `method_means`,
    `gap`, the share of the way from floor to ceiling in PSNR (see `share_of_gap`), and `shared_runs`. A second table
    has the effects for which `blocks` has a second block.
    """
    rows = _named(table[(table.scene == scene) & (table.profile == profile) & (table.track == track)])
    effects = sorted(set(rows.effect) - {CLEAN}) or [CLEAN]
    found = {effect: blocks(rows[rows.effect.isin([effect, CLEAN])]) for effect in effects}
    return [
        _side_by_side({effect: _effect_block(own[i]) for effect, own in found.items() if i < len(own)})
        for i in range(max(map(len, found.values())))
    ]


def _side_by_side(effects: dict[str, pd.DataFrame]) -> pd.DataFrame:
    joined = pd.concat(effects, axis=1)
    return joined.loc[sorted(joined.index, key=_order)]


def _named(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(method=shown_names(rows))


def _order(method: str) -> tuple[bool, bool, str]:
    return method != CEILING, method != FLOOR, method


def _effect_block(block: Block) -> pd.DataFrame:
    kept = compared_runs(block.rows).rows
    means = method_means(block.rows, kept)
    means["gap"] = [share_of_gap(kept, method) for method in means.index]
    return means.assign(shared_runs=block.shared_runs)


def share_of_gap(done: pd.DataFrame, method: str) -> float:
    """(PSNR - floor) / (ceiling - floor), means over a scene's runs that have both references, weighed as elsewhere.

    A run's floor has its pattern, seed and data, its ceiling its seed. NaN where no run has both, one of them lacks its
    PSNR, or the ceiling is not above the floor.
    """
    scores: dict[str, dict[tuple[str, int, str], float]] = defaultdict(dict)  # without merges, which cost milliseconds
    for name, pattern, seed, data, psnr in zip(*(done[column] for column in SCORE), strict=True):
        scores[name][pattern, seed, data] = psnr
    floor, ceiling = scores[FLOOR], {seed: psnr for (_, seed, _), psnr in scores[CEILING].items()}
    own = scores[method]
    if method == CEILING:  # it stands for itself wherever there is a floor
        own = {run: ceiling[run[1]] for run in floor if run[1] in ceiling}
    both = [run for run in own if run in floor and run[1] in ceiling]
    rows = pd.DataFrame([(own[run], floor[run], ceiling[run[1]]) for run in both], columns=range(3), dtype=float)
    patterns = rows.groupby([pattern for pattern, *_ in both]).mean(skipna=False)
    psnr, low, high = patterns.mean(skipna=False)
    return float((psnr - low) / (high - low)) if high > low else float("nan")


def scene_keys(table: pd.DataFrame) -> list[tuple[str, str, str]]:
    """Scene, profile and track of every table there is, sorted by profile, suite (TEST first), scene and track."""
    keys = {(str(row.scene), str(row.profile), str(row.track)) for row in table.itertuples()}
    return sorted(keys, key=lambda key: (key[1], SUITES.index(suite_of(key[0])), key[0], key[2]))


def suite_keys(table: pd.DataFrame) -> list[tuple[str, str, str]]:
    """Profile, track and suite of every table over scenes there is, sorted, TEST first."""
    keys = {(profile, track, suite_of(scene)) for scene, profile, track in scene_keys(table)}
    return sorted(keys, key=lambda key: (key[0], key[1], SUITES.index(key[2])))


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


def rows_of(table: pd.DataFrame, profile: str, track: str, suite: str) -> pd.DataFrame:
    """The runs of a profile, track and suite (empty: of none), with methods as tables name them."""
    kept = (table.profile == profile) & (table.track == track) & (table.scene.map(suite_of) == suite)
    return _named(table[kept])


def grade_of(pattern: str) -> str:
    """light, medium or heavy; empty for what no generator graded: clean views and real rain."""
    number = pattern.rpartition("-")[2]
    return GRADES[int(number) % len(GRADES)] if number.isdecimal() and pattern != CAPTURED else ""


def grade_means(rows: pd.DataFrame) -> pd.DataFrame:
    """Means of `method_means` over scenes by effect and grade: a row an effect, grade and method; may be empty.

    Clean views and real rain, which have no grade, are not in it.
    """
    rainy = rows[rows.pattern != CLEAN]
    rainy = rainy.assign(grade=rainy.pattern.map(grade_of))
    parts = [
        method_means(rainy[(rainy.effect == effect) & (rainy.grade == grade)]).assign(effect=effect, grade=grade)
        for effect in sorted(set(rainy.effect))
        for grade in GRADES
        if ((rainy.effect == effect) & (rainy.grade == grade)).any()
    ]
    return pd.concat(parts) if parts else pd.DataFrame(columns=["effect", "grade"])


def cost_means(rows: pd.DataFrame) -> pd.DataFrame:
    """What methods cost and the quality they give for it, over all runs that are compared: a row a method.

    Besides the numbers of `method_means`, `device`: where they were trained; several are named, since seconds on one
    say nothing of another.
    """
    kept = compared_runs(rows).rows
    means = method_means(rows, kept)
    devices = kept.groupby("method").device.agg(lambda names: "; ".join(sorted({*names.dropna()} - {""})))
    means["device"] = devices.reindex(means.index).fillna("")
    return means.loc[sorted(means.index, key=_order)]


def ablation_means(rows: pd.DataFrame) -> pd.DataFrame:
    """Means of the methods of the paper's ablation over drops and streaks, in its order.

    Those that have runs; none where that is only one, which compares with nothing.
    """
    kept = rows[rows.effect.isin(ABLATED)]
    ours = [method for method in ABLATION if method in set(kept.method)]
    return method_means(kept[kept.method.isin(ours)]).reindex(ours if len(ours) > 1 else [])


@dataclass(frozen=True)
class SuiteTables:
    """What is told of a suite's scenes together; each table may be empty, and has the column `shared_runs`."""

    rows: pd.DataFrame  # the runs it is told of: see `Block`
    grades: pd.DataFrame
    costs: pd.DataFrame
    ablation: pd.DataFrame


@dataclass(frozen=True)
class Tables:
    """All tables of a board, in order."""

    scenes: dict[tuple[str, str, str], pd.DataFrame]  # by scene, profile, track
    suites: dict[tuple[str, str, str], SuiteTables]  # by profile, track, suite
    shared_scenes: dict[tuple[str, str, str], pd.DataFrame]  # second blocks, of those that have one: see `blocks`
    shared_suites: dict[tuple[str, str, str], SuiteTables]


def all_tables(table: pd.DataFrame) -> Tables:
    """Every table of some runs, each calculated once."""
    scenes = {keys: scene_tables(table, *keys) for keys in scene_keys(table)}
    suites = {keys: [_suite_tables(block) for block in found] for keys, found in suite_blocks(table).items()}
    return Tables(
        {keys: first for keys, (first, *_) in scenes.items()},
        {keys: first for keys, (first, *_) in suites.items()},
        {keys: shared for keys, (_, *second) in scenes.items() for shared in second},
        {keys: shared for keys, (_, *second) in suites.items() for shared in second},
    )


def suite_blocks(table: pd.DataFrame) -> dict[tuple[str, str, str], list[Block]]:
    """What is compared of every profile, track and suite, in order: see `blocks`."""
    return {keys: blocks(rows_of(table, *keys)) for keys in suite_keys(table)}


def _suite_tables(block: Block) -> SuiteTables:
    parts = (
        means(block.rows).assign(shared_runs=block.shared_runs) for means in (grade_means, cost_means, ablation_means)
    )
    return SuiteTables(block.rows, *parts)


def tidy_scenes(tables: Tables) -> pd.DataFrame:
    """All scene tables below each other: a row a profile, track, scene, effect, method and `shared_runs`.

    With what the paper published: see `beside_ours`.
    """
    parts = []
    for (scene, profile, track), means in (*tables.scenes.items(), *tables.shared_scenes.items()):
        for effect in dict.fromkeys(means.columns.get_level_values(0)):
            block = means[effect].dropna(subset=["finished"]).rename_axis("method").reset_index()
            keys = {"profile": profile, "track": track, "suite": suite_of(scene), "scene": scene, "effect": effect}
            parts.append(block.assign(**keys).astype(dict.fromkeys(("finished", "planned", "compared"), int)))
    front = ["profile", "track", "suite", "scene", "effect", "method", "reference", "finished", "planned", "compared"]
    joined = pd.concat(parts, ignore_index=True)
    return beside_ours(joined[[*front, *(name for name in joined if name not in {*front, *COSTS}), *COSTS]])


def tidy_ablation(tables: Tables) -> pd.DataFrame:
    """The ablations of all suites below each other, with the paper's names and numbers of the same rows."""
    paper = published_ablation().rename(columns=IN_CSV)
    return tidy_suites(tables, "ablation").merge(paper, how="left", left_on="method", right_index=True)


def tidy_suites(tables: Tables, part: Literal["grades", "costs", "ablation"]) -> pd.DataFrame:
    """One of the tables of all suites below each other."""
    parts = [
        getattr(found, part).rename_axis("method").reset_index().assign(profile=profile, track=track, suite=suite)
        for (profile, track, suite), found in (*tables.suites.items(), *tables.shared_suites.items())
    ]
    front = ["profile", "track", "suite", *(["effect", "grade"] if part == "grades" else []), "method"]
    joined = pd.concat(parts, ignore_index=True)
    return joined[[*front, *(name for name in joined if name not in front)]]
