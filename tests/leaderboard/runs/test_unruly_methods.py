"""Whatever a method does is its own row, with the reason: the evaluation goes on, and all other rows are there."""

import sys

import pandas as pd
import pytest

from hydroviews.errors import InputError
from leaderboard.evaluate import EvaluateRequest, evaluate

pytestmark = pytest.mark.usefixtures("toys", "evaluated")
HOUR = 3600


@pytest.fixture
def row_of(evaluated_once, tmp_path):
    """Evaluates a toy method; its row. The rows of the others are as they were."""

    def row(method: str, **limits) -> pd.Series:
        where = {"data": tmp_path / "data", "results": tmp_path / "results"}
        scene = str(evaluated_once[0] / "yard")
        evaluate(EvaluateRequest(f"toy_methods:{method}", scene, patterns=("streak-0",), **where, **limits))
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
    ],
)
@pytest.mark.usefixtures("trained_here")
def test_it_fails_alone(row_of, method, reason):
    row = row_of(method)
    assert row.status == "failed"
    assert reason in row.reason
    assert row[["psnr", "train_s", "device"]].isna().all()


def test_it_fails_alone_where_it_takes_longer_than_allowed(row_of):
    row = row_of("Hangs", time_limit=1 / HOUR)
    assert row.status == "failed"
    assert "not done after 0.000277778 h (--time-limit, in hours, allows more)" in row.reason


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system limits address space alone")
def test_it_fails_alone_where_it_takes_more_memory_than_allowed(row_of):
    row = row_of("EatsMemory", memory_limit=4.0)
    assert row.status == "failed"
    assert "--memory-limit 4" in row.reason


def test_what_it_prints_and_changes_in_its_memory_is_no_harm(row_of, evaluated):
    row = row_of("PrintsGarbageAndChangesInput")
    assert row.status == "done"
    assert row.psnr == evaluated.scores["psnr"]


def test_a_full_disk_is_not_its_fault_and_ends_the_command(row_of):
    with pytest.raises(InputError, match="no space left on the disk"):
        row_of("FillsTheDisk")
