"""Exported splat files of finished runs."""

from dataclasses import replace

import numpy as np
import pytest
from compressed_ply import read_compressed_ply
from finished_runs import finished_run

from baselines.splatting.files.ply import read_ply
from baselines.splatting.rasterizer import render
from hydroviews.errors import InputError
from hydroviews.metrics import psnr
from leaderboard.viewer.export import export


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished_run(tmp_path_factory.mktemp("export"))


def held_out(run, gaussians) -> np.ndarray:
    cameras = [view.camera.resized(96, 72) for view in run.clean_scene().test_views]
    return np.stack([np.clip(render(gaussians, camera)[0], 0, 1) for camera in cameras]).transpose(0, 3, 1, 2)


def test_ply_shows_exactly_what_the_run_shows(run, tmp_path, caplog):
    export(run.folder, tmp_path / "out.ply", "ply", None)
    assert "300 Gaussians, degree 1" in caplog.text
    own = read_ply(run.folder / "splats.ply")
    assert np.array_equal(held_out(run, read_ply(tmp_path / "out.ply")), held_out(run, own))
    assert (tmp_path / "out.ply").stat().st_size < (run.folder / "splats.ply").stat().st_size


def test_compressed_shows_nearly_what_the_run_shows(run, tmp_path):
    pytest.importorskip("gsply", reason="needs the extra compression")
    export(run.folder, tmp_path / "out.ply", "compressed", None)
    own = read_ply(run.folder / "splats.ply")
    again = replace(read_compressed_ply(tmp_path / "out.ply"), origin=own.origin)
    assert psnr(held_out(run, again), held_out(run, own)).min() > 35


def test_a_lower_degree_is_kept(run, tmp_path):
    export(run.folder, tmp_path / "out.ply", "ply", 0)
    assert read_ply(tmp_path / "out.ply").sh_degree == 0
    with pytest.raises(InputError, match="--sh-degree 2"):
        export(run.folder, tmp_path / "other.ply", "ply", 2)


def test_what_cannot_be_exported_is_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"out\.splat"):
        export(run.folder, tmp_path / "out.splat", "ply", None)
    with pytest.raises(InputError, match="no such run"):
        export(tmp_path / "nowhere", tmp_path / "out.ply", "ply", None)
    grey = finished_run(tmp_path, "Grey")
    with pytest.raises(InputError, match="no Gaussians"):
        export(grey.folder, tmp_path / "out.ply", "ply", None)
