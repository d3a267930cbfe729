"""Parameters that become NaN or infinite while a scene is trained."""

from dataclasses import replace

import numpy as np
import pytest
from splats import photographed
from trainings import BUDGETED, CONFIG, psnr

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.trainer import train

BAD = (("means", np.nan), ("quaternions", np.inf), ("log_scales", np.inf), ("opacity_logits", np.nan), ("sh", -np.inf))


@pytest.fixture
def injected(monkeypatch):
    """Makes a parameter each of some Gaussians non-finite before given steps."""
    step = CpuBackend.step

    def inject_at(*iterations):
        def spoilt_step(self, camera, view, iteration, *arguments):
            if iteration in iterations:
                for row, (name, value) in enumerate(BAD):
                    getattr(self._state.gaussians, name)[row] = value
            return step(self, camera, view, iteration, *arguments)

        monkeypatch.setattr(CpuBackend, "step", spoilt_step)

    return inject_at


@pytest.mark.parametrize("config", [CONFIG, BUDGETED], ids=["densification", "relocation"])
def test_training_goes_on_without_them_and_warns_once(tmp_path, injected, caplog, config):
    scene = photographed(tmp_path)
    injected(45, 90, 170)
    method = GaussianSplatting(replace(config, iterations=400), 0)
    method.fit(scene, tmp_path / "run")
    said = [message for message in caplog.messages if "NaN or infinite" in message]
    assert len(said) == 1
    assert "training: 5 of " in said[0]
    assert "after iteration 60, as" in said[0]
    assert "means of 1, quaternions of 1, log_scales of 1, opacity_logits of 1, sh of 1" in said[0]
    trained = method._trained
    assert trained.non_finite == 15
    assert all(np.isfinite(value).all() for value in trained.gaussians.state_dict().values())
    assert psnr(method, scene.train_views) > 28


def test_what_is_non_finite_at_the_end_is_not_in_the_model(tmp_path, injected):
    injected(29)
    trained = train(photographed(tmp_path), replace(CONFIG, iterations=30), 0, tmp_path / "run")
    assert trained.non_finite == 5
    assert all(np.isfinite(value).all() for value in trained.gaussians.state_dict().values())


def test_a_training_that_leaves_nothing_has_failed(tmp_path, monkeypatch):
    def step(self, camera, view, iteration, *arguments):
        self._state.gaussians.means[:] = np.nan
        return 0.1

    monkeypatch.setattr(CpuBackend, "step", step)
    with pytest.raises(FloatingPointError, match="no Gaussian is left after 2 iterations"):
        train(photographed(tmp_path), replace(CONFIG, iterations=2), 0, tmp_path / "run")
