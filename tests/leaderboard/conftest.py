"""Methods made for tests."""

import shutil
import sys
from pathlib import Path

import pytest
import tyro
from synthetic import written_capture

from hydroviews.errors import InputError
from leaderboard import evaluate
from leaderboard.runs.run import Run, recorded_configuration
from leaderboard.runs.train_and_render import train_and_render
from leaderboard.tables import dataframes as tables


@pytest.fixture
def toys(monkeypatch):
    """The toy methods importable here and in the processes started, and as reference rows."""
    use_toys(monkeypatch)
    yield
    sys.modules.pop("toy_methods", None)


def use_toys(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = str(Path(__file__).parent)
    monkeypatch.setattr(evaluate, "probe", recorded_configuration)  # they can be imported: that process costs a second
    monkeypatch.setenv("PYTHONPATH", folder)
    monkeypatch.syspath_prepend(folder)
    for module in (evaluate, tables):
        monkeypatch.setattr(module, "CEILING", "toy_methods:MeanColourClean")
        monkeypatch.setattr(module, "FLOOR", "toy_methods:MeanColour")


@pytest.fixture
def trained_here(monkeypatch):
    """Evaluations train in this process, where the test is not about the other one: that takes a second to start."""

    monkeypatch.setattr(evaluate, "run_tethered", train_here)


def train_here(module, options, notes, watch, end, memory):
    """What `run_tethered` does of a run, but in this process."""
    run = tyro.cli(Run, args=[option.replace("--run.", "--") for option in options])
    try:
        train_and_render(run)
    except InputError:
        raise
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


@pytest.fixture(scope="session")
def evaluated_once(tmp_path_factory):
    """A capture, and what `evaluate` leaves of MeanColour and the reference rows on it: data, results, records."""
    folder = tmp_path_factory.mktemp("evaluated")
    capture = written_capture(folder / "yard")
    where = {"data": folder / "data", "results": folder / "results"}
    with pytest.MonkeyPatch.context() as monkeypatch:
        use_toys(monkeypatch)
        monkeypatch.setattr(evaluate, "run_tethered", train_here)
        request = evaluate.EvaluateRequest("toy_methods:MeanColour", str(capture), patterns=("streak-0",), **where)
        records = evaluate.evaluate(request)
    sys.modules.pop("toy_methods", None)
    return folder, records


@pytest.fixture
def run(evaluated, tmp_path):
    """That of MeanColour."""
    return Run("toy_methods:MeanColour", "demo", 0, tmp_path / "data/demo", "yard", "streak-0", tmp_path / "results")


@pytest.fixture
def request_of(evaluated_once, tmp_path):
    """Makes a request for a toy method on that capture, with data and results in `tmp_path`."""

    def of(method="MeanColour", **changes):
        settings = {"scene": str(evaluated_once[0] / "yard"), "patterns": ("streak-0",)}
        where = {"data": tmp_path / "data", "results": tmp_path / "results"}
        return evaluate.EvaluateRequest(f"toy_methods:{method}", **{**settings, **where, **changes})

    return of


@pytest.fixture
def evaluated(evaluated_once, tmp_path):
    """The record of MeanColour; data and results are in `tmp_path`, for the test to change."""
    folder, records = evaluated_once
    for name in ("data", "results"):
        shutil.copytree(folder / name, tmp_path / name)
    return records[-1]
