from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.masking.uncertainty import Uncertainty, UncertaintyConfig, counted, uncertainty_loss, warmed
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.images import TrainingImages

CONFIG = UncertaintyConfig(start=10, warm_up=20, rate=0.05)
GROWTH = DefaultStrategy(stop=100, reset_every=None)


class Colours:
    """Blocks of 8x8 pixels: their mean colour, and one minus it."""

    name, alike, unlike = "colours", 0.0, 0.5

    def __call__(self, image):
        blocks = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)
        mean = torch.nn.functional.avg_pool2d(blocks, 8)
        return torch.cat([mean, 1 - mean])


def photographs(n=4, seed=0):
    """Noise, in the left upper quarter of every other one a red square."""
    pixels = np.random.default_rng(seed).integers(60, 120, (n, 32, 48, 3)).astype(np.uint8)
    pixels[::2, :16, :24] = (250, 10, 10)
    return TrainingImages(list(pixels))


def model(images=None, config=CONFIG, growth=GROWTH, features=None, seed=0):
    return Uncertainty(images or photographs(), features or Colours(), config, growth, seed)


@pytest.mark.parametrize("d", [0.02, 0.2, 0.24, 0.26, 0.8])
def test_the_loss_is_smallest_where_its_closed_form_says(d):
    u = torch.linspace(0.1, 2, 19_001, dtype=torch.float64)
    best = u[uncertainty_loss(torch.tensor(d), u, 0.5).argmin()]
    assert best == pytest.approx(max(0.1, (d / 0.5) ** 0.5), abs=2e-4)
    assert counted(best.numpy()) == (d < 0.25)
    assert uncertainty_loss(torch.tensor(0.5), torch.tensor(2.0), 0.5) == pytest.approx(0.0625 + 0.5 * np.log(2))


def test_weights_turn_from_one_to_those_predicted():
    assert [warmed(i, CONFIG) for i in (0, 10, 15, 30, 99)] == [0, 0, 0.25, 1, 1]
    assert warmed(11, replace(CONFIG, warm_up=0)) == 1
    taught = model()
    with torch.no_grad():
        taught.head.bias.fill_(5.0)  # everything is uncertain
    assert taught.weights(0, (32, 48), 10) is None
    assert np.allclose(taught.weights(0, (32, 48), 15), 0.75)
    assert not taught.weights(0, (16, 24), 30).any()
    with torch.no_grad():
        taught.head.bias.fill_(-9.0)
    assert taught.weights(0, (32, 48), 30).min() == 1
    assert taught.uncertainty(0, (32, 48)).min() == np.float32(CONFIG.least)
    assert np.allclose(model().uncertainty(1, (32, 48)), 1, atol=0.1)  # as training starts


def test_what_no_render_shows_becomes_uncertain_and_nothing_else():
    images = photographs()
    taught = model(images)
    for iteration in range(200):
        view = iteration % 4
        render = images.pixels(view | 1) / np.float32(255)  # the noise of another picture, never a square
        taught.learn(render, view, iteration)
    for view in range(4):
        weights = taught.weights(view, (32, 48), 1000)
        assert weights[:, 28:].min() == 1
        assert weights[20:].min() == 1
        assert weights[2:12, 2:20].mean() == (view % 2)


def test_lessons_wait_after_opacities_were_reset():
    growth = DefaultStrategy(reset_every=50, stop=120)
    taught = model(config=replace(CONFIG, protected=10), growth=growth)
    protected = [i for i in range(300) if taught.is_protected(i)]
    assert protected == [*range(50, 60), *range(100, 110)]
    before = taught.state_dict()
    taught.learn(np.zeros((32, 48, 3), np.float32), 0, 55)
    assert all(np.array_equal(value, before[name]) for name, value in taught.state_dict().items())
    taught.learn(np.zeros((32, 48, 3), np.float32), 0, 60)
    assert not np.array_equal(taught.state_dict()["network.weight"], before["network.weight"])
    assert not any(model(growth=MCMCStrategy()).is_protected(i) for i in range(300))


def test_a_view_that_is_wholly_hidden_teaches_nothing():
    """Black beside black would be alike, and certain."""
    images = photographs()
    taught = model(TrainingImages([images.pixels(i) for i in range(4)], [np.ones((32, 48), bool), None, None, None]))
    before = taught.uncertainty(1, (32, 48))
    taught.learn(images.pixels(1) / np.float32(255), 0, 0)
    assert np.array_equal(taught.uncertainty(1, (32, 48)), before)
