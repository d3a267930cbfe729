"""Losses that a GPU may calculate itself, and others."""

import numpy as np
import pytest
from splats import BACKGROUND, cloud, photographed

from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.kernels.photometric import prepare_target
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import StepOptions
from baselines.training.images import read_images


class Renamed(Objective):
    """Compares nothing in another way."""

    def settings(self):
        return {**super().settings(), "name": "Objective"}


class Halved(Objective):
    def __call__(self, image, view, iteration, buffers):
        loss, gradient = super().__call__(image, view, iteration, buffers)
        return loss / 2, gradient / 2


class Grey(Objective):
    def target(self, view, size=None):
        pixels = self.images.pixels(view, size)
        return prepare_target(np.full_like(pixels, 128))


class Weighed(Objective):
    def weights(self, render, view, size, iteration, buffers):
        return np.linspace(0, 2, size[0] * size[1], dtype=np.float32).reshape(size)


class Brightest(Objective):
    """Weighs by what is rendered."""

    def weights(self, render, view, size, iteration, buffers):
        return render().max(axis=2)


@pytest.mark.parametrize("kind", [Objective, Renamed, Weighed, Brightest, Halved, Grey])
def test_the_gpu_takes_the_cpus_step_whatever_the_loss(tmp_path, cuda_backend, kind):
    scene = photographed(tmp_path, n_views=3)
    losses, means = [], []
    for backend in (cuda_backend, CpuBackend):
        trained = backend(kind(read_images(scene.train_views)), BACKGROUND, 0.01)
        trained.put(fresh_state(cloud(20, 1)))
        rates = rates_at(0, 100, LearningRates(), 4.0, 1)
        losses.append(trained.step(scene.train_views[0].camera, 0, 0, 1, rates, StepOptions()))
        means.append(trained.get(1, 0.0).first.means)
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    assert means[0] == pytest.approx(means[1], rel=1e-3, abs=1e-4 * np.abs(means[1]).max())
