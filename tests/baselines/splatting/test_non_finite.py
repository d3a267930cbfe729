"""Parameters that become NaN or infinite while a scene is trained."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import camera, cloud, photographed, with_values
from trainings import BUDGETED, CONFIG, psnr

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.backends.torch_ops import without_non_finite as torch_without_non_finite
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.rasterizer import backward, render
from baselines.splatting.state import fresh_state, without_non_finite
from baselines.splatting.trainer import train

BAD = (("means", np.nan), ("quaternions", np.inf), ("log_scales", np.inf), ("opacity_logits", np.nan), ("sh", -np.inf))


def non_finite_cloud():
    gaussians = cloud(100, 1)
    for row, (name, value) in enumerate(BAD):
        gaussians = with_values(gaussians, name, row, value)
    return gaussians


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


def test_they_are_neither_shown_nor_taught():
    image, state = render(non_finite_cloud(), camera(60, 40))
    rest = cloud(100, 1).select(np.arange(len(BAD), 100))
    weights = np.random.default_rng(0).normal(size=image.shape)
    ours = backward(state, weights).parameters.map(np.copy)
    expected, state = render(rest, camera(60, 40))
    theirs = backward(state, weights).parameters
    assert np.array_equal(image, expected)
    for name in FIELDS:
        assert not getattr(ours, name)[: len(BAD)].any()
        assert np.array_equal(getattr(ours, name)[len(BAD) :], getattr(theirs, name))


def test_in_torch_they_are_transparent_and_get_no_gradient():
    leaves = {name: torch.from_numpy(v.copy()).requires_grad_() for name, v in non_finite_cloud().state_dict().items()}
    shown, whole = torch_without_non_finite(leaves)
    assert torch.nonzero(~whole)[:, 0].tolist() == list(range(len(BAD)))
    sum((value**2).sum() for value in shown.values()).backward()
    for value in leaves.values():
        assert not value.grad[: len(BAD)].any()
        assert torch.equal(value.grad[len(BAD) :], 2 * value.detach()[len(BAD) :])


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


def test_a_sound_state_stays_as_it_is():
    state = fresh_state(cloud(10, 1))
    assert without_non_finite(state) is state
