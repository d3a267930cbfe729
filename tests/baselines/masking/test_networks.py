"""Networks that learn from features of photographs what is no part of the scene."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.masking.feature_network import MaskNetwork, MaskNetworkConfig, averaged, encoded_places, hinge
from baselines.masking.uncertainty import Uncertainty, UncertaintyConfig, counted, uncertainty_loss, warmed
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.images import TrainingImages

CONFIG = UncertaintyConfig(start=10, warm_up=20, rate=0.05)
SIZE = 32, 48
GROWTH = DefaultStrategy(stop=100, reset_every=None)


class Colours:
    """Blocks of 8x8 pixels: their mean colour, and one minus it."""

    name, alike, unlike = "colours", 0.0, 0.5

    def __call__(self, image):
        blocks = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)
        mean = torch.nn.functional.avg_pool2d(blocks, 8)
        return torch.cat([mean, 1 - mean])


def photographs(ignored=()):
    """Four of noise, in the left upper quarter of every other one a red square."""
    pixels = np.random.default_rng(0).integers(60, 120, (4, *SIZE, 3)).astype(np.uint8)
    pixels[::2, :16, :24] = (250, 10, 10)
    return TrainingImages(list(pixels), ignored)


def model(images=None, config=CONFIG, growth=GROWTH):
    return Uncertainty(images or photographs(), Colours(), config, growth, 0)


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
    taught.head.bias.data.fill_(5.0)  # everything is uncertain
    assert taught.weights(0, SIZE, 10) is None
    assert np.allclose(taught.weights(0, SIZE, 15), 0.75)
    assert not taught.weights(0, (16, 24), 30).any()
    taught.head.bias.data.fill_(-9.0)
    assert taught.weights(0, SIZE, 30).min() == 1
    assert taught.uncertainty(0, SIZE).min() == np.float32(CONFIG.least)
    assert np.allclose(model().uncertainty(1, SIZE), 1, atol=0.1)  # as training starts


def test_what_no_render_shows_becomes_uncertain_and_nothing_else():
    images = photographs()
    taught = model(images)
    for iteration in range(200):
        view = iteration % 4
        render = images.pixels(view | 1) / np.float32(255)  # the noise of another picture, never a square
        taught.learn(render, view, iteration)
    for view in range(4):
        weights = taught.weights(view, SIZE, 1000)
        assert min(weights[:, 28:].min(), weights[20:].min()) == 1
        assert weights[2:12, 2:20].mean() == (view % 2)


def test_lessons_wait_after_opacities_were_reset():
    growth, black = DefaultStrategy(reset_every=50, stop=120), np.zeros((*SIZE, 3), np.float32)
    taught = model(config=replace(CONFIG, protected=10), growth=growth)
    assert [i for i in range(300) if taught.is_protected(i)] == [*range(50, 60), *range(100, 110)]
    before = taught.state_dict()
    taught.learn(black, 0, 55)
    assert all(np.array_equal(value, before[name]) for name, value in taught.state_dict().items())
    taught.learn(black, 0, 60)
    assert not np.array_equal(taught.state_dict()["network.weight"], before["network.weight"])
    assert not any(model(growth=MCMCStrategy()).is_protected(i) for i in range(300))


def test_a_view_that_is_wholly_hidden_teaches_nothing():
    """Black beside black would be alike, and certain."""
    images = photographs([np.ones(SIZE, bool), None, None, None])
    taught = model(images)
    before = taught.uncertainty(1, SIZE)
    taught.learn(images.pixels(1) / np.float32(255), 0, 0)
    assert np.array_equal(taught.uncertainty(1, SIZE), before)


VGG = MaskNetworkConfig("vgg", rate=2e-2)


def blocks(image):
    """Mean colours of 8x8 pixels, and a constant."""
    mean = Colours()(image)[:3]
    return torch.cat([mean, torch.full_like(mean[:1], 0.7)])


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 1.0), (1.0, 1.0), (0.0, 0.0), (0.25, 0.75)])
def test_the_loss_is_zero_between_the_masks_and_pulls_p_there_from_outside(lower, upper):
    p = torch.linspace(0, 1, 11, dtype=torch.float64, requires_grad=True)
    loss = hinge(p, torch.tensor(lower), torch.tensor(upper))
    away = [max(v - upper, 0) + max(lower - v, 0) for v in p.tolist()]
    assert np.allclose(loss.detach(), away, atol=1e-15)
    loss.sum().backward()
    assert p.grad.tolist() == [int(v > upper) - int(v < lower) for v in p.tolist()]


def test_places_are_encoded_by_octaves_of_both_axes_and_averaged():
    encoded = encoded_places(3, 5, 4).double().numpy()
    assert encoded.shape == (15, 16)
    y, x = 1 / 2 * 2.0 ** np.arange(4), 3 / 4 * 2.0 ** np.arange(4)
    assert np.allclose(encoded[1 * 5 + 3], np.concatenate([np.sin(y), np.sin(x), np.cos(y), np.cos(x)]), atol=1e-6)
    assert torch.isfinite(encoded_places(1, 1, 20)).all()
    plane = np.repeat([True, False], (2, 6))[:, None].repeat(8, axis=1)
    assert np.allclose(averaged(plane, (2, 2)), [[0.5, 0.5], [0, 0]])  # shares under positions


def test_what_looks_like_outliers_is_left_out_where_residuals_say_nothing():
    """Learned from views 0 and 1 alone; view 2 has a square as view 0 has."""
    network, square = MaskNetwork(photographs(), blocks, VGG, 0), np.zeros(SIZE, bool)
    nothing, everything = np.zeros_like(square), np.ones_like(square)
    square[:16, :24] = True
    for iteration in range(150):
        inlier = ~square if iteration % 2 == 0 else everything
        network.learn(iteration % 2, inlier, inlier)
    p = network.learn(2, nothing, everything)  # L and U that any p is between
    assert p[4:12, 4:20].max() < 0.3
    assert p[24:, 30:].min() > 0.7


def test_p_has_the_size_of_the_masks_and_a_state_restores_it():
    network, again = (MaskNetwork(photographs(), blocks, VGG, seed, extra=1) for seed in (0, 5))
    inlier, plane = np.ones((16, 24), bool), np.full((4, 6), 0.5, np.float32)
    first = network.learn(1, ~inlier, ~inlier, extra=[plane])
    assert first.shape == (16, 24)
    again.load_state_dict(network.state_dict())
    one, other = (net.learn(1, inlier, inlier, extra=[plane]) for net in (network, again))
    assert np.array_equal(one, other)
    assert not np.array_equal(one, first)
    prior = MaskNetwork(photographs(), blocks, MaskNetworkConfig("vgg", prior=0.9), 0)
    assert prior.learn(0, inlier, inlier).mean() == pytest.approx(0.9, abs=0.06)
