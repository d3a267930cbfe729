"""Writes the pages: an index, a page a scene, a page a run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from tqdm import tqdm

from baselines.method import METHODS, Citation, citation_of
from hydroviews.cli.plugins import registered
from hydroviews.dataset.suites import suite_of
from hydroviews.files import ownership
from hydroviews.files.atomic import write_bytes
from hydroviews.files.full_disk import plain_write_errors
from hydroviews.files.locks import BUSY, locked
from hydroviews.metrics import find_metrics
from hydroviews.profiles import PROFILES
from hydroviews.rain.patterns import GRADES
from leaderboard.records import FLOOR, GIVEN_POSES, RAINY_POSES, SPARSE_VIEWS, effect_of
from leaderboard.site.hidden_pictures import hidden_pictures
from leaderboard.site.learning_curves import learning_curves
from leaderboard.site.pareto import Plot, draw
from leaderboard.site.pictures import Pictures, Thumbnails, scene_pictures
from leaderboard.site.runs import ShownRun, page_name, shown_runs
from leaderboard.tables.dataframes import cost_means, rows_of, scene_keys, suite_keys
from leaderboard.tables.markdown import COST_TITLES, cost_text
from leaderboard.tables.means import blocks, shown_names
from leaderboard.tables.paper_numbers import NOTE, published_scores
from leaderboard.tables.rankings import Ranking, rankings
from leaderboard.tables.statistics import LEAST_SCENES

SITE = "site"  # in a results folder
INDEX = "index.html"
ASSETS = ("style.css", "script.js")
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


@dataclass(frozen=True)
class SuitePart:
    """What the index has of a profile, track and suite (empty: scenes of none)."""

    profile: str
    track: str
    suite: str
    rankings: list[Ranking]
    plots: list[Plot]  # of the runs that all methods have


@dataclass(frozen=True)
class ScenePage:
    """A scene in a profile and track."""

    name: str
    profile: str
    track: str
    suite: str
    page: str
    rankings: list[Ranking]
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
        runs = shown_runs(table, results)
        thumbnails = Thumbnails(out / "pictures")
        scenes = _scenes(table, runs, data, thumbnails)
        written = _write_pages(out, runs, scenes, _suites(table))
        kept = written | {thumbnails.folder / name for name in thumbnails.written}
        for folder in ("runs", "scenes", "pictures"):
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
        pages.append(ScenePage(*keys, suite_of(scene), page_name(*keys), ranked, pictures, hidden))
    return pages


def _write_pages(out: Path, runs: list[ShownRun], scenes: list[ScenePage], suites: list[SuitePart]) -> set[Path]:
    pages = environment()
    addresses = {(scene.name, scene.profile, scene.track): scene.page for scene in scenes}
    pictured = any(scene.pictures for scene in scenes)
    own: dict[str, Any] = {
        "runs": runs,
        "scenes": scenes,
        "suites": suites,
        "filters": _filters(runs),
        "pictured": pictured,
    }
    own["cited"] = _cited(runs)
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


def _cited(runs: list[ShownRun]) -> dict[str, Citation]:
    """What the registered methods of some runs follow, by name, without wrappers."""
    names = sorted({run.record["method"].partition("+")[0] for run in runs if not run.record["submitted_by"]})
    found = {name: citation_of(name) for name in names if name in registered(METHODS)}
    return {name: citation for name, citation in found.items() if citation}


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
        "paper_of": lambda scene, effect: published_scores(scene, effect).to_dict("index"),
        "effect_of": effect_of,
        "floor": FLOOR,
        "legend": LEGEND,
        "sides": {name: profile.long_side for name, profile in PROFILES.items()},
        "tracks": TRACK_TITLES,
        "isnan": math.isnan,
    }
    return pages
