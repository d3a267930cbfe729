"""What takes long to import is imported where it is used."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("modules", "unwanted"),
    [
        # what a run of 3dgs imports before it trains
        (
            "leaderboard.runs.train_and_render, baselines.gaussian_splatting",
            {"torch", "pandas", "scipy.special", "viser"},
        ),
        ("hydroviews.__main__", {"torch", "pandas", "numba", "scipy"}),
        # every command, before it is known which
        (
            "hydroviews.__main__, leaderboard.__main__, leaderboard.evaluate, leaderboard.doctor, deraings.reconstruct",
            {"torch", "numba", "viser", "bpy", "scipy"},
        ),
    ],
)
def test_it_is_not_imported_before(modules, unwanted):
    code = f"import sys, {modules}; print(*sorted({unwanted} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
