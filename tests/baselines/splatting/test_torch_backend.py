"""The GPU's steps, with a stand-in for gsplat, and the CPU's."""

import sys

import numpy as np
import pytest
from splats import BACKGROUND, cloud, photographed, with_values

from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import LearningRates, rates_at, shrunk
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import PositionNoise, StepOptions
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.images import TrainingImages, read_images
from hydroviews.errors import InputError


@pytest.fixture
def backends(cuda_backend, tmp_path):
    scene = photographed(tmp_path)
    objective = Objective(read_images(scene.train_views))
    return (
        [view.camera for view in scene.train_views],
        [kind(objective, BACKGROUND, 0.01) for kind in (CpuBackend, cuda_backend)],
    )


def test_a_gsplat_without_kernels_is_refused(cuda_backend, monkeypatch):
    monkeypatch.setattr(sys.modules["gsplat.cuda._backend"], "_C", None)
    with pytest.raises(InputError, match=r"no compiled CUDA code[\s\S]*nvcc"):
        cuda_backend(Objective(TrainingImages([np.zeros((16, 16, 3), np.uint8)])), BACKGROUND, 0.01)


MCMC = MCMCStrategy(noise=0.0, opacity_penalty=1.0, scale_penalty=1.0)


@pytest.mark.parametrize("strategy", [DefaultStrategy(), DefaultStrategy(absolute=True), MCMC])
def test_both_take_the_same_steps(backends, strategy):
    cameras, both = backends
    states = []
    for backend in both:
        backend.put(fresh_state(cloud(80, 2)))
        for iteration in range(4):
            rates = rates_at(iteration, 100, LearningRates(), 4.0, 2)
            step_options = strategy.step_options(iteration, rates["means"], 4.0, 0)
            camera = shrunk(cameras[iteration], 2 if iteration < 2 else 1)
            loss = backend.step(camera, iteration, iteration, 2, rates, step_options)
        states.append((backend.get(4, 0.0), loss, backend.residual(cameras[5], 5, 2)))
    (ours, our_loss, our_residual), (theirs, their_loss, their_residual) = states
    assert our_loss == pytest.approx(their_loss, rel=1e-4)
    assert our_residual == pytest.approx(their_residual, rel=1e-4)
    if strategy == DefaultStrategy(absolute=True):  # the stand-in's are those of sums
        assert (ours.gradient_sum >= 0.98 * theirs.gradient_sum - 1e-6).all()
        assert theirs.gradient_sum.any()
    else:
        assert np.allclose(ours.gradient_sum, theirs.gradient_sum, rtol=2e-2, atol=1e-6)
    for name in FIELDS:
        one, two = getattr(ours.gaussians, name), getattr(theirs.gaussians, name)
        assert np.quantile(np.abs(one - two), 0.9) < 1e-5, name
        assert not np.array_equal(one, getattr(cloud(80, 2), name)), name


def test_both_say_the_same_of_contributions(backends):
    cameras, both = backends
    gaussians = with_values(cloud(80, 1), "sh", slice(0, 10), -5)
    ours, theirs = [], []
    for backend, weights in zip(both, (ours, theirs), strict=True):
        backend.put(fresh_state(gaussians))
        weights.extend(backend.contributions(cameras[:2]))
    assert np.allclose(ours, theirs, rtol=1e-3, atol=1e-3)
    assert sum(ours) > 100


def test_noise_moves_the_transparent_ones_alone(backends):
    cameras, (_, backend) = backends
    gaussians = with_values(cloud(80, 1), "opacity_logits", slice(None), 3.0)
    gaussians = with_values(gaussians, "opacity_logits", slice(0, 20), -9.0)
    still = dict.fromkeys(FIELDS, 0.0)
    moved = []
    for seed in (0, 0, 1):
        backend.put(fresh_state(gaussians))
        backend.step(cameras[0], 0, 0, 1, still, StepOptions(noise=PositionNoise(1.0, np.random.default_rng(seed))))
        moved.append(backend.get(1, 0.0).gaussians.means - gaussians.means)
    assert moved[0][:20].all()
    assert np.abs(moved[0][20:]).max() < 1e-6
    assert np.array_equal(moved[0], moved[1])
    assert not np.array_equal(moved[0], moved[2])


def test_non_finite_ones_are_counted_and_learn_nothing(backends):
    cameras, both = backends
    gaussians = with_values(with_values(cloud(80, 1), "means", 3, np.nan), "sh", 5, np.inf)
    rates = rates_at(0, 100, LearningRates(), 4.0, 1)
    for backend in both:
        backend.put(fresh_state(gaussians))
        loss = backend.step(cameras[0], 0, 0, 1, rates, StepOptions())
        after = backend.get(1, 0.0).gaussians
        assert backend.non_finite() == 2
        assert np.isfinite(loss)
        rest = np.setdiff1d(np.arange(80), [3, 5])
        assert all(np.isfinite(value[rest]).all() for value in after.state_dict().values())
        assert np.array_equal(after.quaternions[[3, 5]], gaussians.quaternions[[3, 5]])
