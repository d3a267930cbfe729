"""Which losses a GPU may calculate itself."""

import numpy as np
import pytest
from splats import BACKGROUND, cloud, photographed

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


@pytest.fixture
def images(tmp_path):
    return read_images(photographed(tmp_path, n_views=3).train_views)


def test_a_loss_is_photometric_until_it_is_replaced(images):
    assert [kind(images).is_photometric for kind in (Objective, Renamed, Halved, Grey)] == [True, True, False, False]


@pytest.mark.parametrize("kind", [Renamed, Halved, Grey])
def test_the_gpu_asks_an_objective_that_compares_otherwise(tmp_path, cuda_backend, kind, monkeypatch):
    scene = photographed(tmp_path, n_views=3)
    objective, asked = kind(read_images(scene.train_views)), []
    compare = Objective.compare
    monkeypatch.setattr(Objective, "compare", lambda *given: asked.append(given[2]) or compare(*given))
    backend = cuda_backend(objective, BACKGROUND, 0.01)
    backend.put(fresh_state(cloud(20, 1)))
    backend.step(scene.train_views[0].camera, 0, 0, 1, rates_at(0, 100, LearningRates(), 4.0, 1), StepOptions())
    assert asked == ([] if kind is Renamed else [0])
