"""Colours that are made by networks: gradients, steps, means over views."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from looks import assert_the_same_steps
from splats import BACKGROUND, camera, cloud, photographed, with_values

from baselines.splatting.appearance.base import Appearance
from baselines.splatting.appearance.gaussians import AppearanceGaussians, in_sight, with_appearance
from baselines.splatting.appearance.networks import linear_of_parts
from baselines.splatting.appearance.view_averages import mean_over_views
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.gaussians import join
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import StepOptions
from baselines.training.images import read_images
from baselines.training.torch_state import module_arrays, restore_module


class Tint(Appearance):
    """A gain a view and channel, and an offset from each Gaussian's two features; the second set has neither."""

    def __init__(self, views: int) -> None:
        super().__init__()
        self.gains = torch.nn.Parameter(torch.zeros(views, 3))
        self.mix = torch.nn.Parameter(torch.full((2, 3), 0.1))
        self.optimiser = torch.optim.Adam(self.parameters(), lr=0.05)

    def features(self, gaussians):
        return np.ascontiguousarray(0.1 * gaussians.means[:, :2])

    def sh_sets(self, parameters, camera, view, degree):
        gain = self.gains[view]
        offset = torch.zeros_like(parameters["sh"])
        offset[:, 0] = parameters["features"] @ self.mix
        return parameters["sh"] * gain.exp() + offset, parameters["sh"]

    def learn(self, iteration):
        self.optimiser.step()
        self.optimiser.zero_grad()

    def feature_rate(self, iteration):
        return 0.01

    def training_state(self):
        return module_arrays(self, self.optimiser)

    def load_training_state(self, arrays):
        restore_module(self, arrays, self.optimiser)


class Both(Objective):
    """Half of the loss is that of the plain render."""

    def compare(self, images, view, iteration, buffers):
        target = self.target(view, images[0].shape[:2])
        parts = [photometric_loss(image, target, self.lambda_dssim) for image in images]
        return sum(loss for loss, _ in parts) / 2, [gradient / 2 for _, gradient in parts]


def both_looks(images):
    return Both(images, appearance=Tint(len(images)))


def with_features(n):
    return with_appearance(cloud(n, 1), Tint(1))


def test_features_go_where_their_gaussians_go():
    gaussians = with_features(10)
    both = join(gaussians, np.arange(3), gaussians.select(np.arange(10) > 7))
    assert np.array_equal(both.features, gaussians.features[[0, 1, 2, 8, 9]])
    assert gaussians.bare().features is None
    assert gaussians.zeros().features.shape == (10, 2)
    with pytest.raises(ValueError, match="features"):
        replace(gaussians, features=np.zeros((3, 2), np.float32))


@pytest.mark.parametrize(("size", "most"), [(0.001, 100), (0.03, 200), (0.3, 301)])
def test_who_is_shown_is_in_sight(size, most):
    gaussians, view = cloud(300, 0, size=size), camera(20, 14)
    view = replace(view, fx=5 * view.fx, fy=5 * view.fy)
    _, state = render(gaussians, view)
    rows, seen = in_sight({name: torch.from_numpy(value) for name, value in gaussians.state_dict().items()}, view)
    assert set(np.flatnonzero(state.visible)) <= set(rows.tolist())
    assert 5 < state.visible.sum() <= len(rows) < most
    assert np.array_equal(seen["sh"], gaussians.sh[rows])


@pytest.mark.parametrize("kind", ["cpu", "gsplat"])
def test_a_view_of_nothing_teaches_nothing(tmp_path, cuda_backend, kind):
    scene = photographed(tmp_path, n_views=3)
    backend = {"cpu": CpuBackend, "gsplat": cuda_backend}[kind](
        both_looks(read_images(scene.train_views)), BACKGROUND, 0.01
    )
    backend.put(fresh_state(with_features(20)))
    away, pose = scene.train_views[0].camera, np.diag([-1.0, 1.0, -1.0, 1.0])
    away = replace(away, world_to_camera=pose @ away.world_to_camera)
    before = {name: value.copy() for name, value in backend.get(0, 0.0).gaussians.state_dict().items()}
    rates = {**rates_at(0, 100, LearningRates(), 4.0, 1), "features": 0.01}
    assert np.isfinite(backend.step(away, 0, 0, 1, rates, StepOptions(watch=True)))
    after = backend.get(1, 0.0)
    assert not after.seen.any()
    assert all(np.array_equal(value, after.gaussians.state_dict()[name]) for name, value in before.items())


def test_non_finite_gaussians_leave_the_network_whole():
    gaussians, appearance = with_values(with_features(20), "features", 3, np.nan), Tint(1)
    visible = AppearanceGaussians(gaussians, appearance, camera(16, 12), 0, 1)
    assert len(visible.rows) == 19
    visible.backward(visible.gaussians.map(np.ones_like), np.ones_like(visible.sh), BufferPool())
    assert all(torch.isfinite(parameter.grad).all() for parameter in appearance.parameters())


def test_the_gpu_takes_the_same_steps(tmp_path, cuda_backend):
    assert_the_same_steps(tmp_path, cuda_backend, both_looks, loss_error=1e-4, error=1e-5)


def averaged(gaussians, cameras):
    """Means of the numbers of views, once as they are and once ten times as large; who was asked of by each view."""
    asked = []

    def values(view, local, seen):
        asked.append((view, len(seen["means"])))
        return torch.full((len(seen["means"]), 2), float(view)) * torch.tensor([1.0, 10.0])

    return mean_over_views(gaussians, cameras, values, 0.01, False, torch.device("cpu"), "numbers"), asked


def test_a_view_counts_for_as_much_as_it_shows_of_a_gaussian():
    far, near = camera(40, 30, 0.0, origin=(4, 0, 0)), camera(40, 30, 0.0)
    ball = replace(cloud(2, 0), means=np.array([[0, 0, 0], [0, 0, 90]], np.float32))  # the second is in sight of none
    for name, value in (("log_scales", np.log(0.2)), ("quaternions", [1, 0, 0, 0]), ("opacity_logits", 2)):
        ball = with_values(ball, name, slice(None), value)
    found, asked = averaged(ball, [far, near])
    assert asked == [(0, 1), (1, 1)]
    # Twice as near shows four times as many pixels, but for what a splat is widened by.
    assert 0.75 < found[0, 0] < 0.81
    assert np.allclose(found[:, 1], 10 * found[:, 0])
    assert np.allclose(found[1], found[0])


def test_what_is_hidden_does_not_count():
    pair = with_values(cloud(2, 0), "opacity_logits", slice(None), 9)
    pair = with_values(pair, "means", slice(None), [[1.5, 0, 0], [-1.5, 0, 0]])
    pair = with_values(pair, "log_scales", slice(None), np.log([[0.8], [0.1]]))
    found, _ = averaged(pair, [camera(40, 30, 0.0), camera(40, 30, np.pi)])  # in front and behind
    assert found[1, 0] > 0.95  # the large one hides it from the front
    assert 0.05 < found[0, 0] < 0.95


def test_linear_parts_are_those_side_by_side_with_their_gradients():
    linear = torch.nn.Linear(9, 4).double()
    parts = [torch.randn(5, width, dtype=torch.float64, requires_grad=True) for width in (2, 3, 4)]
    pull = torch.randn(5, 4, dtype=torch.float64)
    said, expected = linear_of_parts(linear, *parts), linear(torch.cat(parts, dim=1))
    assert torch.allclose(said, expected)
    learned = [*parts, *linear.parameters()]
    gradients = (torch.autograd.grad(values, learned, pull) for values in (said, expected))
    assert all(torch.allclose(found, true) for found, true in zip(*gradients, strict=True))
    with pytest.raises(ValueError, match="5 numbers for a layer of 9"):
        linear_of_parts(linear, *parts[:2])
    zeros = torch.zeros(5, 7, dtype=torch.float64)  # a number stands for a part of them
    assert torch.allclose(linear_of_parts(linear, parts[0], 7), linear(torch.cat([parts[0], zeros], dim=1)))
