"""What the pages show: suites on the index, scenes, and methods with their scores by rain, grade and scene."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from baselines.method import METHODS, WRAPPERS, Citation, citation_of, find_wrapper
from hydroviews.cli.plugins import registered
from hydroviews.dataset.clean_views import CLEAN
from leaderboard.records import effect_of
from leaderboard.site.pareto import Plot
from leaderboard.site.pictures import Pictures
from leaderboard.site.runs import ShownRun, page_name
from leaderboard.tables.paper_numbers import published_scores
from leaderboard.tables.rankings import RankedMethod, Ranking

PLACE = ("scene", "profile", "track")  # of a run, what its scene's page is of


@dataclass(frozen=True)
class SuitePart:
    """A part of the index: a profile, a track and a suite (empty: scenes of none)."""

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


@dataclass(frozen=True)
class SceneScores:
    """A method's scores on one scene under one pattern."""

    scene: ScenePage
    scores: RankedMethod
    paper: Mapping[str, Any]  # what its publication reports, see `paper_numbers`; empty if nothing
    runs: tuple[ShownRun, ...]


@dataclass(frozen=True)
class RainScores:
    """A method's scores under one pattern, over scenes and on each."""

    ranking: Ranking
    scores: RankedMethod
    scenes: tuple[SceneScores, ...]


@dataclass(frozen=True)
class MethodPart:
    """A method's scores in a profile, track and suite."""

    suite: SuitePart
    rains: tuple[RainScores, ...]


@dataclass(frozen=True)
class MethodPage:
    """A method: what it follows, how it is run, its scores."""

    name: str  # as tables have it
    page: str
    citation: Citation | None
    command: str  # that runs it; empty for what was submitted
    wrappers: Mapping[str, str]  # by name, what each of them does
    parts: tuple[MethodPart, ...]
    runs: tuple[ShownRun, ...]


def scene_page(row: Mapping[str, Any] | pd.Series) -> str:
    """The name of the file that a run's scene is in, in its profile and track."""
    return page_name(*(row[key] for key in PLACE))


def method_page(name: str) -> str:
    """The name of the file that a method's page is in, by its name in tables."""
    return page_name("method", name)


def method_pages(
    runs: Sequence[ShownRun], suites: Sequence[SuitePart], scenes: Sequence[ScenePage]
) -> list[MethodPage]:
    """A page for every method that has runs, by name."""
    return [_page(name, runs, suites, scenes) for name in sorted({run.name for run in runs})]


def _page(name: str, runs: Sequence[ShownRun], suites: Sequence[SuitePart], scenes: Sequence[ScenePage]) -> MethodPage:
    own = tuple(run for run in runs if run.name == name)
    method, theirs = own[0].record["method"], own[0].record["submitted_by"]
    citation = None if theirs else _citation(method)
    command = "" if theirs else shlex.join(["hydroviews", "eval", method])
    wrappers = {} if theirs else {one: _purpose(one) for one in method.split("+")[1:]}
    parts = [MethodPart(suite, tuple(_rains(name, suite, scenes, own))) for suite in suites]
    scored = tuple(part for part in parts if part.rains)
    return MethodPage(name, method_page(name), citation, command, wrappers, scored, own)


def _citation(method: str) -> Citation | None:
    """The citation of a registered method, without its wrappers; a name of any other kind is not imported."""
    return citation_of(method) if method.partition("+")[0] in registered(METHODS) else None


def _purpose(wrapper: str) -> str:
    """The first line of what a registered wrapper says of itself; empty for any other name."""
    known = wrapper in registered(WRAPPERS)
    return (find_wrapper(wrapper).__doc__ or "").partition("\n")[0] if known else ""


def _rains(name: str, suite: SuitePart, scenes: Sequence[ScenePage], runs: Sequence[ShownRun]) -> Iterator[RainScores]:
    place = (suite.profile, suite.track, suite.suite)
    own = [scene for scene in scenes if (scene.profile, scene.track, scene.suite) == place]
    for ranking, scores in _found(name, suite.rankings):
        yield RainScores(ranking, scores, tuple(_scenes(name, ranking.pattern, own, runs)))


def _scenes(name: str, pattern: str, scenes: Sequence[ScenePage], runs: Sequence[ShownRun]) -> Iterator[SceneScores]:
    for scene in scenes:
        for _, scores in _found(name, [one for one in scene.rankings if one.pattern == pattern]):
            there = [run for run in runs if scene_page(run.record) == scene.page]
            own = tuple(run for run in there if run.record["pattern"] in (pattern, CLEAN))
            paper = published_scores(scene.name, effect_of(pattern)).to_dict("index").get(name, {})
            yield SceneScores(scene, scores, {str(column): value for column, value in paper.items()}, own)


def _found(name: str, rankings: Sequence[Ranking]) -> Iterator[tuple[Ranking, RankedMethod]]:
    """A method's row in each ranking that has one."""
    return ((ranking, one) for ranking in rankings for one in ranking.methods if one.method == name)
