"""The GPU's steps against the CPU's where there is a real GPU; `test_torch_backend` has a pretended one."""

import numpy as np
import pytest
from splats import BACKGROUND, camera, cloud, photographed

from baselines.splatting.backends.base import GSPLAT, CpuBackend
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.devices import missing_for_cuda
from baselines.training.images import read_images


@pytest.fixture
def backends(tmp_path):
    if lacking := missing_for_cuda(GSPLAT):
        pytest.skip(f"needs an NVIDIA GPU and gsplat: {lacking}")
    from baselines.splatting.backends.cuda import CudaBackend

    scene = photographed(tmp_path)
    objective = Objective(read_images(scene.train_views))
    return scene, [kind(objective, BACKGROUND, 0.01) for kind in (CpuBackend, CudaBackend)]


def translucent(n):
    """Below gsplat's and our largest alpha, which differ."""
    gaussians = cloud(n, 3)
    np.clip(gaussians.opacity_logits, None, 1.5, out=gaussians.opacity_logits)
    return gaussians


def test_both_render_the_same(backends):
    _, (_, gpu) = backends
    gaussians = translucent(300)
    ours = render(gaussians, camera(120, 90), BACKGROUND)[0]
    theirs = gpu.render(gaussians, camera(120, 90))
    assert np.abs(ours - theirs).mean() < 1e-4
    assert np.abs(ours - theirs).max() < 2e-2  # cut-offs at 1/255 may fall on either side


@pytest.mark.parametrize("strategy", [DefaultStrategy(), DefaultStrategy(absolute=True), MCMCStrategy(noise=0.0)])
def test_both_take_the_same_steps(backends, strategy):
    scene, both = backends
    states = []
    for backend in both:
        backend.put(fresh_state(translucent(300)))
        losses = []
        for iteration in range(5):
            rates = rates_at(iteration, 100, LearningRates(), 4.0, 3)
            view = iteration % len(scene.train_views)
            step_options = strategy.step_options(iteration, rates["means"], 4.0, 0)
            losses.append(backend.step(scene.train_views[view].camera, view, iteration, 3, rates, step_options))
        states.append((backend.get(5, 0.0), losses))
    (ours, our_losses), (theirs, their_losses) = states
    assert our_losses == pytest.approx(their_losses, rel=1e-2)
    assert np.median(np.abs(ours.gradient_sum - theirs.gradient_sum)) <= 1e-2 * np.median(ours.gradient_sum)
    for name in FIELDS:
        one, two = getattr(ours.gaussians, name), getattr(theirs.gaussians, name)
        assert np.median(np.abs(one - two)) < 1e-4, name
