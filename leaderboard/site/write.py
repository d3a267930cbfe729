"""Writes the pages: an index, a page a scene, a page a run."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from tqdm import tqdm

from hydroviews.dataset.suites import suite_of
from hydroviews.files import ownership
from hydroviews.files.atomic import write_bytes
from hydroviews.files.full_disk import plain_write_errors
from hydroviews.files.locks import BUSY, locked
from hydroviews.metrics import find_metrics
from hydroviews.rain.patterns import GRADES
from leaderboard.gather import collect_views
from leaderboard.site.hidden_pictures import hidden_pictures
from leaderboard.site.intervals import Told, comparisons
from leaderboard.site.learning_curves import learning_curves
from leaderboard.site.pareto import Plot, draw
from leaderboard.site.pictures import Pictures, Thumbnails, scene_pictures
from leaderboard.site.runs import ShownRun, page_name, shown_runs
from leaderboard.tables.dataframes import SuiteTables, Tables, all_tables
from leaderboard.tables.markdown import COST_TITLES, SHARED, basis, cost_text
from leaderboard.tables.means import incomplete, places
from leaderboard.tables.paper_numbers import NOTE, published_scores

SITE = "site"  # in a results folder
INDEX = "index.html"
ASSETS = ("style.css", "script.js")
PLOTTED = ("train_s", "peak_mem_mb", "model_mb", "n_primitives")
FILTERS = ("profile", "track", "suite", "scene", "effect", "grade", "status")


@dataclass(frozen=True)
class SuitePart:
    """What the index tells of a profile, track and suite (empty: scenes of none) on some runs: see `Block`."""

    profile: str
    track: str
    suite: str
    shared: bool  # of all methods, on the runs that all of them have
    told: list[Told]
    tables: SuiteTables
    plots: list[Plot]


@dataclass(frozen=True)
class ScenePage:
    """A scene in a profile and track."""

    name: str
    profile: str
    track: str
    suite: str
    page: str
    tables: list[pd.DataFrame]  # see `tables.scene_tables`
    pictures: Mapping[str, Pictures]
    hidden: Mapping[str, Pictures]


def write_site(table: pd.DataFrame, results: Path, data: Path) -> Path:
    """Write the pages into SITE in a results folder; what is there of runs that are no longer there goes.

    Args:
        table: the runs, as `gather.collect` has them.
        results: their folder.
        data: folder that the scenes were built in; where data are missing or have changed, so are their pictures.

    Returns:
        The path of the index.

    Raises:
        ReadOnly: nothing may be written there.
    """
    out = results / SITE
    with locked(out, BUSY):
        with plain_write_errors(out):
            for folder in ("runs", "scenes", "pictures"):
                (out / folder).mkdir(parents=True, exist_ok=True)
            ownership.claim(out)
        runs, tables = shown_runs(table, results), all_tables(table)
        thumbnails = Thumbnails(out / "pictures")
        scenes = _scenes(runs, tables, data, thumbnails)
        written = _write_pages(out, runs, scenes, _suites(table, tables, results))
        kept = written | {thumbnails.folder / name for name in thumbnails.written}
        for folder in ("runs", "scenes", "pictures"):
            for path in set((out / folder).iterdir()) - kept:
                ownership.remove(path)
    return out / INDEX


def _suites(table: pd.DataFrame, tables: Tables, results: Path) -> list[SuitePart]:
    views = collect_views(table, results)
    parts = []
    for keys in tables.suites:
        profile, track, suite = keys
        own = views[(views.profile == profile) & (views.track == track) & (views.suite == suite)]
        for shared, by_suite in ((False, tables.suites), (True, tables.shared_suites)):
            if keys in by_suite:
                found = by_suite[keys]
                plots = [draw(found.costs, name, COST_TITLES[name], find_metrics()[0]) for name in PLOTTED]
                told = comparisons(table.loc[found.rows.index], own)
                parts.append(SuitePart(*keys, shared, told, found, [plot for plot in plots if plot]))
    return parts


def _scenes(runs: list[ShownRun], tables: Tables, data: Path, thumbnails: Thumbnails) -> list[ScenePage]:
    pages = []
    for keys, found in tables.scenes.items():
        own = [run for run in runs if tuple(run.record[key] for key in ("scene", "profile", "track")) == keys]
        pictures = scene_pictures(own, data, thumbnails)
        hidden = hidden_pictures(own, data, thumbnails)
        shown = [found, *([tables.shared_scenes[keys]] if keys in tables.shared_scenes else [])]
        pages.append(ScenePage(*keys, suite_of(keys[0]), page_name(*keys), shown, pictures, hidden))
    return pages


def _write_pages(out: Path, runs: list[ShownRun], scenes: list[ScenePage], suites: list[SuitePart]) -> set[Path]:
    pages = environment()
    addresses = {(scene.name, scene.profile, scene.track): scene.page for scene in scenes}
    pictured = any(scene.pictures for scene in scenes)
    own = {"runs": runs, "scenes": scenes, "suites": suites, "filters": _filters(runs), "pictured": pictured}
    texts = {out / INDEX: pages.get_template(INDEX).render(root="", **own)}
    for scene in scenes:
        texts[out / "scenes" / scene.page] = pages.get_template("scene.html").render(root="../", scene=scene)
    template = pages.get_template("run.html")
    for run in tqdm(runs, desc="pages", unit="run", leave=False, disable=len(runs) < 200):
        keys = (run.record["scene"], run.record["profile"], run.record["track"])
        own = {"run": run, "scene_page": addresses[keys], "curves": learning_curves(run.folder)}
        texts[out / "runs" / run.page] = template.render(root="../", **own)
    for name in ASSETS:
        texts[out / name] = (Path(__file__).parent / name).read_text(encoding="utf-8")
    for path, text in texts.items():
        if not path.is_file() or path.read_bytes() != text.encode():
            write_bytes(path, text.encode())
    return set(texts)


def _filters(runs: list[ShownRun]) -> dict[str, list[str]]:
    """The values of each filter, those with more than one."""
    found = {name: sorted({str(filter_value(run, name)) for run in runs}) for name in FILTERS}
    return {name: values for name, values in found.items() if len(values) > 1}


def filter_value(run: ShownRun, name: str) -> str:
    """What a run has in a filter."""
    return str({"suite": run.suite, "grade": run.grade or "none"}.get(name) or run.record[name])


def environment() -> Environment:
    """Templates in which everything is escaped, and a name that is not given is an error."""
    pages = Environment(
        loader=PackageLoader("leaderboard.site"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pages.policies["json.dumps_kwargs"] = {"sort_keys": False}  # the order of pictures is that of the choices
    pages.globals |= {
        "metrics": find_metrics(),
        "grades": GRADES,
        "costs": COST_TITLES,
        "paper_note": NOTE,
        "FILTERS": FILTERS,
        "filter_value": filter_value,
        "cost_text": cost_text,
        "effects_of": lambda table: list(dict.fromkeys(table.columns.get_level_values(0))),
        "block_of": lambda table, effect: table[effect].dropna(subset=["finished"]),
        "paper_of": lambda scene, effect: published_scores(scene, effect).to_dict("index"),
        "basis": basis,
        "shared_title": SHARED,
        "rows": _rows,
    }
    return pages


def _rows(means: pd.DataFrame) -> list[dict[str, Any]]:
    """A table's rows for a template: numbers, None where there is none, with `place` by metric and `missing`."""
    place = {metric.name: places(means, metric) for metric in find_metrics()}
    return [
        {str(name): None if pd.isna(value) else value for name, value in row.items()}
        | {"method": str(method), "missing": incomplete(row)}
        | {"place": {name: found.get(str(method)) for name, found in place.items()}}
        for method, row in means.to_dict("index").items()
    ]
