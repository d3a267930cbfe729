"""Writes the pages: an index, a page per method, per scene and per run."""

import math
from collections.abc import Mapping
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
from hydroviews.profiles import PROFILES
from hydroviews.rain.patterns import GRADES
from leaderboard.gather import publication
from leaderboard.records import FLOOR, GIVEN_POSES, RAINY_POSES, SPARSE_VIEWS, effect_of
from leaderboard.site.contents import ScenePage, SuitePart, method_page, method_pages, scene_page
from leaderboard.site.hidden_pictures import hidden_pictures
from leaderboard.site.learning_curves import learning_curves
from leaderboard.site.pareto import draw
from leaderboard.site.pictures import Thumbnails, scene_pictures
from leaderboard.site.runs import ShownRun, shown_runs
from leaderboard.tables.dataframes import cost_means, rows_of, scene_keys, suite_keys
from leaderboard.tables.markdown import COST_TITLES, cost_text
from leaderboard.tables.means import blocks, shown_names
from leaderboard.tables.paper_numbers import NOTE, published_scores
from leaderboard.tables.rankings import rankings
from leaderboard.tables.statistics import LEAST_SCENES

SITE = "site"  # in a results folder
INDEX = "index.html"
ASSETS = ("style.css", "script.js")
FOLDERS = ("methods", "runs", "scenes", "pictures")
PLOTTED = ("train_s", "peak_mem_mb", "model_mb", "n_primitives")
TRACK_TITLES = {
    GIVEN_POSES: "known cameras",
    SPARSE_VIEWS: "known cameras, a third of the training views",
    RAINY_POSES: "cameras estimated from rainy photographs",
}
LEGEND = (
    f"Each number is a mean over the scenes that the method has. Gain: mean difference to {FLOOR} in PSNR, in pairs of "
    f"runs on the same data, with its 95 % confidence interval over scenes from {LEAST_SCENES} scenes on. Methods are "
    "ranked by gain; on the same scenes this is the order of their means. The sign ≈ marks a method whose difference "
    "to the row above has an interval that holds 0. Grey: fewer scenes than other methods. Bold: best of the methods "
    "with most scenes. Without a rank: trained on clean views."
)
FILTERS = ("profile", "track", "suite", "scene", "effect", "grade", "status")


def write_site(table: pd.DataFrame, results: Path, data: Path, docs: str = "") -> Path:
    """Write the pages into SITE in a results folder; what is there of runs that are no longer there goes.

    Args:
        table: the runs, as `gather.collect` has them.
        results: their folder.
        data: folder that the scenes were built in; where data are missing or have changed, so are their pictures.
        docs: address of the documentation's start folder, absolute or as seen from the index; empty: no links to it.

    Returns:
        The path of the index.

    Raises:
        ReadOnly: nothing may be written there.
    """
    out = results / SITE
    with locked(out, BUSY):
        with plain_write_errors(out):
            for folder in FOLDERS:
                (out / folder).mkdir(parents=True, exist_ok=True)
            ownership.claim(out)
        runs = shown_runs(table, results)
        thumbnails = Thumbnails(out / "pictures")
        scenes = _scenes(table, runs, data, thumbnails)
        written = _write_pages(out, runs, scenes, _suites(table), environment(docs, publication(results)))
        kept = written | {thumbnails.folder / name for name in thumbnails.written}
        for folder in FOLDERS:
            for path in set((out / folder).iterdir()) - kept:
                ownership.remove(path)
    return out / INDEX


def _suites(table: pd.DataFrame) -> list[SuitePart]:
    parts = []
    for keys in suite_keys(table):
        rows = rows_of(table, *keys)
        costs = cost_means(blocks(rows)[-1].rows)
        plots = [draw(costs, name, COST_TITLES[name], find_metrics()[0]) for name in PLOTTED]
        parts.append(SuitePart(*keys, rankings(rows), [plot for plot in plots if plot]))
    return parts


def _scenes(table: pd.DataFrame, runs: list[ShownRun], data: Path, thumbnails: Thumbnails) -> list[ScenePage]:
    pages = []
    for scene, profile, track in scene_keys(table):
        keys = (scene, profile, track)
        rows = table[(table.scene == scene) & (table.profile == profile) & (table.track == track)]
        own = [run for run in runs if tuple(run.record[key] for key in ("scene", "profile", "track")) == keys]
        pictures = scene_pictures(own, data, thumbnails)
        hidden = hidden_pictures(own, data, thumbnails)
        ranked = rankings(rows.assign(method=shown_names(rows)))
        pages.append(ScenePage(*keys, suite_of(scene), scene_page(rows.iloc[0]), ranked, pictures, hidden))
    return pages


def _write_pages(
    out: Path, runs: list[ShownRun], scenes: list[ScenePage], suites: list[SuitePart], pages: Environment
) -> set[Path]:
    methods = method_pages(runs, suites, scenes)
    own: dict[str, Any] = {
        "runs": runs,
        "scenes": scenes,
        "suites": suites,
        "methods": methods,
        "filters": _filters(runs),
        "pictured": any(scene.pictures for scene in scenes),
    }
    texts = {out / INDEX: pages.get_template(INDEX).render(root="", **own)}
    for method in methods:
        texts[out / "methods" / method.page] = pages.get_template("method.html").render(root="../", method=method)
    for scene in scenes:
        texts[out / "scenes" / scene.page] = pages.get_template("scene.html").render(root="../", scene=scene)
    template = pages.get_template("run.html")
    for run in tqdm(runs, desc="pages", unit="run", leave=False, disable=len(runs) < 200):
        own = {"run": run, "scene_page": scene_page(run.record), "curves": learning_curves(run.folder)}
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


def environment(docs: str, published: Mapping[str, str]) -> Environment:
    """Templates in which everything is escaped, and a name that is not given is an error.

    Args:
        docs: see `write_site`.
        published: when and with which version the runs were published, as `publication` has them; empty: not at all.
    """
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
        "paper_of": lambda scene, effect: published_scores(scene, effect).to_dict("index"),
        "effect_of": effect_of,
        "floor": FLOOR,
        "legend": LEGEND,
        "sides": {name: profile.long_side for name, profile in PROFILES.items()},
        "tracks": TRACK_TITLES,
        "isnan": math.isnan,
        "method_page": method_page,
        "published": published,
        "docs": docs,
        "to_docs": lambda root: docs if "://" in docs else root + docs,
    }
    return pages
