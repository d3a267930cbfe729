"""Whatever a method does is its own row, with the reason: the evaluation goes on, and all other rows are there."""

import sys

import pandas as pd
import pytest

from hydroviews.errors import InputError
from leaderboard.evaluate import evaluate
from leaderboard.records import LONGEST

pytestmark = pytest.mark.usefixtures("toys", "evaluated")
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system limits address space alone")
HOUR = 3600
NUMBERS = ["psnr", "ssim", "lpips_alex", "train_s", "model_mb"]
LEFTOVERS = 8  # of `LeavesInTheWay`; the last takes the run's folder itself away


@pytest.fixture
def row_of(request_of, tmp_path):
    """Evaluates a toy method; its row. The rows of the others are as they were."""

    def row(method: str, **limits) -> pd.Series:
        evaluate(request_of(method, **limits))
        table = pd.read_csv(tmp_path / "results" / "leaderboard.csv").set_index("method")
        assert list(table.status.drop(f"toy_methods:{method}")) == ["done", "done"]
        return table.loc[f"toy_methods:{method}"]

    return row


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        ("Refuses", "RefusedByMethod: camera.bin: this is no scene for me"),
        ("RefusesToRender", "RefusedByMethod: camera: too wide for me"),
        ("RendersTooSmall", "view-00: rendered float32 (35, 48, 3), expected float32 (36, 48, 3)"),
        ("RendersNan", "view-00: rendered NaN in 1,728 of 1,728 pixels"),
        ("NothingLeft", "training has left no Gaussians"),
        ("Rambles", r"ValueError: \ud800\x1b[31mxxx"),  # as long as a book, with what is no character
    ],
)
@pytest.mark.usefixtures("trained_here")
def test_it_fails_alone(row_of, method, reason):
    row = row_of(method)
    assert row.status == "failed"
    assert reason in row.reason
    assert len(row.reason) <= LONGEST
    assert row[[*NUMBERS, "device"]].isna().all()


@pytest.mark.parametrize("seed", range(LEFTOVERS))
@pytest.mark.usefixtures("trained_here")
def test_it_fails_alone_where_it_leaves_something_in_the_way_of_its_run(request_of, tmp_path, seed):
    for _ in range(2):  # and so it does the next time
        record = evaluate(request_of("LeavesInTheWay", seed=seed))[-1]
        assert record.status == "failed"
        assert "left something of its own where its run writes" in record.reason or seed == LEFTOVERS - 1
    table = pd.read_csv(tmp_path / "results" / "leaderboard.csv")
    assert sorted(table[table.seed == seed].status) == ["done", "done", "failed"]


@pytest.mark.usefixtures("trained_here")
def test_numbers_of_a_library_are_numbers(row_of):
    row = row_of("NumpyScalars")
    assert (row.status, row.train_s, row.n_primitives, row.model_mb) == ("done", 0.5, 7, 0.001)


@pytest.mark.parametrize(
    ("method", "message"), [("NoGpu", "^device cuda:9: unknown"), ("FillsTheDisk", "no space left on the disk")]
)
def test_what_is_wrong_with_the_machine_is_not_its_fault_and_ends_the_command(row_of, monkeypatch, method, message):
    monkeypatch.delenv("HYDROVIEWS_DEVICE", raising=False)
    with pytest.raises(InputError, match=message):
        row_of(method)


@pytest.mark.parametrize(
    ("method", "limit", "reason"),
    [
        ("Killed", {}, "ended by SIGKILL"),
        ("Hangs", {"time_limit": 1 / HOUR}, "not done after 0.000277778 h (--time-limit, in hours, allows more)"),
        pytest.param("EatsMemory", {"memory_limit": 4.0}, "--memory-limit 4", marks=LINUX),
    ],
)
def test_it_fails_alone_where_it_is_killed_or_takes_more_than_allowed(row_of, method, limit, reason):
    row = row_of(method, **limit)
    assert row.status == "failed"
    assert reason in row.reason
    assert row[NUMBERS].isna().all()


def test_what_it_prints_and_changes_in_its_memory_is_no_harm(row_of, evaluated):
    row = row_of("PrintsGarbageAndChangesInput")
    assert (row.status, row.psnr) == ("done", evaluated.scores["psnr"])
