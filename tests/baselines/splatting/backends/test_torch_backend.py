"""The GPU's steps and the CPU's: on a pretended GPU that replays gsplat's kernels, and on a real one."""

from dataclasses import replace

import numpy as np
import pytest
from splats import BACKGROUND, camera, cloud, photographed, with_values

from baselines.splatting.backends.base import GSPLAT, CpuBackend
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.photometric import prepare_target
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.schedule import LearningRates, rates_at, shrunk
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import StepOptions
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.devices import missing_for_cuda
from baselines.training.images import TrainingImages, read_images


def backends_of(kind, folder):
    """The cameras of a scene, and backends of the CPU and of a GPU."""
    scene = photographed(folder)
    objective = Objective(read_images(scene.train_views))
    cameras = [view.camera for view in scene.train_views]
    return cameras, [backend(objective, BACKGROUND, 0.01) for backend in (CpuBackend, kind)]


@pytest.fixture
def backends(cuda_backend, tmp_path):
    return backends_of(cuda_backend, tmp_path)


@pytest.fixture
def real(tmp_path):
    if lacking := missing_for_cuda(GSPLAT):
        pytest.skip(f"needs an NVIDIA GPU and gsplat: {lacking}")
    from baselines.splatting.backends.cuda import CudaBackend

    return backends_of(CudaBackend, tmp_path)


RATES = rates_at(0, 100, LearningRates(), 4.0, 1)
NO_PICTURE = Objective(TrainingImages([np.zeros((16, 16, 3), np.uint8)]))


def stepped(backend, cameras, gaussians, strategy):
    """The state after a step in each of these views, and the losses."""
    backend.put(fresh_state(gaussians))
    losses, degree = [], gaussians.sh_degree
    for view, seen_from in enumerate(cameras):
        rates = rates_at(view, 100, LearningRates(), 4.0, degree)
        step_options = strategy.step_options(view, rates["means"], 4.0, 0)
        losses.append(backend.step(seen_from, view, view, degree, rates, step_options))
    return backend.get(len(cameras), 0.0), losses


@pytest.mark.parametrize("antialiased", [False, True])
def test_both_draw_the_same(cuda_backend, antialiased):
    seen_from = replace(camera(75, 52), cx=31.0, cy=30.5, fy=60.0)
    gaussians = with_values(cloud(200, 3), "opacity_logits", slice(0, 150), 1.0)
    gaussians = with_values(gaussians, "means", slice(0, 4), [[0, -0.6, -4], [9, 0, 0], [4, -0.6, 1.3], [0, 0, 0]])
    ours, _ = render(gaussians, seen_from, BACKGROUND, near=0.01, antialiased=antialiased)
    apart = np.abs(ours - cuda_backend(NO_PICTURE, BACKGROUND, 0.01, antialiased).render(gaussians, seen_from))
    assert apart.mean() < 2e-6
    assert np.quantile(apart, 0.99) < 2e-5  # cut-offs may fall on either side


def test_a_view_of_nothing_is_the_background(backends):
    cameras, (_, backend) = backends
    nothing = cloud(0, 1)
    backend.put(fresh_state(nothing))
    assert np.isfinite(backend.step(cameras[0], 0, 0, 1, RATES, StepOptions()))
    assert np.allclose(backend.render(nothing, cameras[0]), BACKGROUND)


def test_gsplat_lets_one_gaussian_cover_more(cuda_backend):
    wall = with_values(with_values(cloud(1, 0), "opacity_logits", 0, 20.0), "log_scales", 0, 1.0)
    wall = with_values(with_values(wall, "means", 0, 0), "sh", 0, -9)  # black
    middle = cuda_backend(NO_PICTURE, np.ones(3, np.float32), 0.01).render(wall, camera(33, 33))[16, 16]
    assert middle == pytest.approx(0.001, abs=2e-5)  # of the background shows; ours ends at 0.01


MCMC = MCMCStrategy(noise=0.0, opacity_penalty=1.0, scale_penalty=1.0)


@pytest.mark.parametrize("strategy", [DefaultStrategy(), DefaultStrategy(absolute=True), MCMC])
def test_both_take_the_same_steps(backends, strategy):
    cameras, both = backends
    seen = [shrunk(each, 2 if view < 2 else 1) for view, each in enumerate(cameras[:4])]
    (ours, our_losses), (theirs, their_losses) = (stepped(backend, seen, cloud(80, 2), strategy) for backend in both)
    assert our_losses == pytest.approx(their_losses, rel=1e-4)
    our_residual, their_residual = (backend.residual(cameras[5], 5, 2) for backend in both)
    assert our_residual == pytest.approx(their_residual, rel=1e-4)
    assert np.allclose(ours.gradient_sum, theirs.gradient_sum, rtol=2e-2, atol=1e-6)
    assert theirs.gradient_sum.any() == strategy.step_options(0, 1.0, 4.0, 0).watch
    for name in FIELDS:
        one, two = getattr(ours.gaussians, name), getattr(theirs.gaussians, name)
        assert np.quantile(np.abs(one - two), 0.9) < 1e-5, name
        assert not np.array_equal(one, getattr(cloud(80, 2), name)), name


def test_both_say_the_same_of_contributions(backends):
    cameras, both = backends
    gaussians = with_values(cloud(80, 1), "sh", slice(0, 10), -5)
    for backend in both:
        backend.put(fresh_state(gaussians))
    ours, theirs = (backend.contributions(cameras[:2]) for backend in both)
    assert np.allclose(ours, theirs, rtol=1e-3, atol=1e-3)
    assert sum(ours) > 100


def test_what_a_step_breaks_is_not_shown_in_the_next(backends):
    cameras, (_, backend) = backends
    backend.put(fresh_state(cloud(80, 1)))
    broken = {**RATES, "sh": np.where(np.arange(12).reshape(4, 3) == 5, np.inf, RATES["sh"]).astype(np.float32)}
    for given in (broken, RATES, RATES):
        assert np.isfinite(backend.step(cameras[0], 0, 0, 1, given, StepOptions()))
    assert backend.non_finite()


def test_non_finite_ones_are_counted_and_learn_nothing(backends):
    cameras, both = backends
    gaussians = with_values(with_values(cloud(80, 1), "means", 3, np.nan), "sh", 5, np.inf)
    rest = np.setdiff1d(np.arange(80), [3, 5])
    for backend in both:
        backend.put(fresh_state(gaussians))
        assert np.isfinite(backend.step(cameras[0], 0, 0, 1, RATES, StepOptions()))
        after = backend.get(1, 0.0).gaussians
        assert backend.non_finite() == 2
        assert all(np.isfinite(value[rest]).all() for value in after.state_dict().values())
        assert np.array_equal(after.quaternions[[3, 5]], gaussians.quaternions[[3, 5]])


def translucent(n):
    """Below gsplat's and our largest alpha, which differ."""
    gaussians = cloud(n, 3)
    return replace(gaussians, opacity_logits=gaussians.opacity_logits.clip(max=1.5))


def test_a_real_gpu_renders_the_same(real):
    gaussians, (_, gpu) = translucent(300), real[1]
    apart = np.abs(render(gaussians, camera(120, 90), BACKGROUND)[0] - gpu.render(gaussians, camera(120, 90)))
    assert apart.mean() < 1e-4
    assert apart.max() < 2e-2  # cut-offs at 1/255 may fall on either side


@pytest.mark.parametrize("strategy", [DefaultStrategy(), DefaultStrategy(absolute=True), MCMCStrategy(noise=0.0)])
def test_a_real_gpu_takes_the_same_steps(real, strategy):
    cameras, both = real
    (ours, our_losses), (theirs, their_losses) = (stepped(b, cameras[:5], translucent(300), strategy) for b in both)
    assert our_losses == pytest.approx(their_losses, rel=1e-2)
    assert np.median(np.abs(ours.gradient_sum - theirs.gradient_sum)) <= 1e-2 * np.median(ours.gradient_sum)
    for name in FIELDS:
        one, two = getattr(ours.gaussians, name), getattr(theirs.gaussians, name)
        assert np.median(np.abs(one - two)) < 1e-4, name


class Halved(Objective):
    def __call__(self, image, view, iteration, buffers):
        loss, gradient = super().__call__(image, view, iteration, buffers)
        return loss / 2, gradient / 2


class Grey(Objective):
    def target(self, view, size=None):
        return prepare_target(np.full_like(self.images.pixels(view, size), 128))


class Weighed(Objective):
    def weights(self, render, view, size, iteration, buffers):
        return np.linspace(0, 2, size[0] * size[1], dtype=np.float32).reshape(size)


class Brightest(Objective):
    """Weighs by what is rendered."""

    def weights(self, render, view, size, iteration, buffers):
        return render().max(axis=2)


@pytest.mark.parametrize("kind", [Objective, Weighed, Brightest, Halved, Grey])
def test_the_gpu_takes_the_cpus_step_whatever_the_loss(tmp_path, cuda_backend, kind):
    scene = photographed(tmp_path, n_views=3)
    losses, means = [], []
    for backend in (cuda_backend, CpuBackend):
        trained = backend(kind(read_images(scene.train_views)), BACKGROUND, 0.01)
        trained.put(fresh_state(cloud(20, 1)))
        losses.append(trained.step(scene.train_views[0].camera, 0, 0, 1, RATES, StepOptions()))
        means.append(trained.get(1, 0.0).first.means)
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    assert means[0] == pytest.approx(means[1], rel=1e-3, abs=1e-4 * np.abs(means[1]).max())
