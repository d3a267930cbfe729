"""Mist and a drop together: the rain model finds each of them where it was drawn."""

import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.training.images import TrainingImages
from deraings.rain_model.drops import LensDropsConfig
from deraings.rain_model.mist_config import MistConfig
from deraings.rain_model.model import RainConfig, RainModel
from deraings.rain_model.objective import RainObjective

SIZE = panorama.HEIGHT, panorama.WIDTH
COUNT, STEPS = 14, 280
MIST = panorama.slanted_mist(0.4)
AIR = np.array([0.55, 0.6, 0.65], np.float32)
DROP = (slice(18, 30), slice(5, 17))  # of the lens, in pixels, where there is hardly any mist
WET = RainConfig(mist=MistConfig(start=0), drops=LensDropsConfig(min_share=0.01), rain_layer=None)


@pytest.fixture(scope="module")
def trained() -> RainModel:
    """A model that has seen photographs of a known scene through mist and one drop."""
    scene = panorama.views_of(panorama.paint(), COUNT)
    photographs = panorama.misted(scene, MIST, AIR)
    photographs[(slice(None), *DROP)] = panorama.shaded_drop(12, 12)
    objective, buffers = RainObjective(TrainingImages(panorama.eight_bit(photographs)), STEPS, WET), BufferPool()
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape).astype(np.float32)
    for step in range(STEPS):
        objective(scene[step % COUNT] + error[step % COUNT], step % COUNT, step, buffers)
    return objective.model


def test_the_mist_is_found(trained):
    errors = np.array([trained.mist_alpha(view, SIZE) - MIST for view in range(COUNT)])
    assert np.sqrt((errors**2).mean(axis=(1, 2))).mean() < 0.06
    assert abs(errors.mean()) < 0.05


def test_the_drop_is_found(trained):
    drop = np.zeros(SIZE, bool)
    drop[DROP] = True
    found = np.array([trained.drop_alpha(view, SIZE) > 0.5 for view in range(COUNT)])
    both, either = (found & drop).sum(axis=(1, 2)), (found | drop).sum(axis=(1, 2))
    assert (both / either).mean() > 0.8
    assert (both / drop.sum()).mean() > 0.85


def test_no_rain_is_taken_for_falling(trained):
    assert trained.even_alpha == pytest.approx(0, abs=1e-3)
