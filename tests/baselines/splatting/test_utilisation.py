"""How much the views depend on where Gaussians are."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import camera, cloud, with_values

from baselines.splatting.backends import torch_rasterizer
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.kernels.rasterizer import render
from baselines.splatting.objective import Objective
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.pruning import Pruning, prune
from baselines.splatting.strategies.utilisation import UtilisationPruning, utilisation
from baselines.training.images import TrainingImages

CAMERAS = [camera(24, 18, angle) for angle in (0.3, 1.9)]


def test_use_is_the_sum_of_squared_mean_absolute_gradients():
    """Against float64 gradients of every pixel by the splats' positions."""
    gaussians = cloud(12, 0)
    expected = np.zeros(12)
    for view in CAMERAS:
        shift = torch.zeros(12, 2, dtype=torch.float64, requires_grad=True)
        image = torch_rasterizer.render(
            torch_rasterizer.tensors(gaussians), view, torch.zeros(3), 0, near=0.01, shift=shift
        )
        values = image.reshape(-1)  # of every pixel and channel
        each = torch.eye(len(values), dtype=torch.float64)
        moved = torch.autograd.grad(values, shift, each, is_grads_batched=True)[0].abs()
        mean = moved.sum(0) / image.numel() * torch.tensor([view.width / 2, view.height / 2])
        expected += mean.square().sum(dim=1).numpy()
    assert np.allclose(utilisation(gaussians, CAMERAS, 0.01), expected, rtol=2e-3, atol=1e-12)


def test_what_is_hidden_or_transparent_is_of_no_use_and_goes_first():
    gaussians = with_values(cloud(30, 0), "opacity_logits", slice(0, 5), -30.0)
    use = utilisation(gaussians, CAMERAS, 0.01)
    assert not use[:5].any()
    left = prune(fresh_state(gaussians), use, UtilisationPruning(threshold=1e-14))
    assert len(left.gaussians) == int((use >= 1e-14).sum()) <= 25
    before, after = (render(g, CAMERAS[0])[0] for g in (gaussians, left.gaussians))
    assert np.abs(before - after).max() < 1e-3


def test_a_backend_is_asked_for_what_the_pruning_wants(tmp_path):
    backend = CpuBackend(Objective(TrainingImages([])), np.zeros(3, np.float32), 0.01)
    backend.put(fresh_state(cloud(20, 1)))
    by_use, by_weight = (kind().use(backend, CAMERAS) for kind in (UtilisationPruning, Pruning))
    assert np.array_equal(by_use, utilisation(cloud(20, 1), CAMERAS, 0.01))
    assert np.array_equal(by_weight, backend.contributions(CAMERAS))


def test_a_gpu_says_the_same(cuda_backend):
    gaussians = replace(cloud(20, 1))
    found = []
    for kind in (CpuBackend, cuda_backend):
        backend = kind(Objective(TrainingImages([])), np.zeros(3, np.float32), 0.01)
        backend.put(fresh_state(gaussians))
        found.append(backend.utilisation(CAMERAS))
    assert found[1] == pytest.approx(found[0], rel=1e-2, abs=1e-9)
