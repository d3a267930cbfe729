"""The visibility mask: where it leads, what it may not do, what the whole loss is, and the price of masking."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.encoders.objective import PerceptualObjective, perceptual_loss
from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT
from baselines.masking.rays import GREY, LEAST, PriceConfig, Running, price_of_masking
from baselines.masking.visibility import learn_visibility, visibility_loss
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss
from baselines.training.checkpoints import read_arrays, write_arrays
from baselines.training.images import TrainingImages
from baselines.training.torch_state import module_arrays, restore_module

ALWAYS = replace(SHORT, visible_from=0.0, rate_maps=5e-3)
HEIGHT, WIDTH = 46, 70  # no multiples of what the network works at


def pictures():
    return np.random.default_rng(0).integers(40, 120, (4, HEIGHT, WIDTH, 3)).astype(np.uint8)


def objective(pixels, config=ALWAYS):
    images = TrainingImages(list(pixels))
    return PerceptualObjective(images, 0.2, ReferenceAppearance(images, config, 1, 100, 0))


def taught(rule, renders):
    """The masks after some steps of the encoder, with renders that stay as they are."""
    for i in range(80):
        view = i % len(renders)
        rule.appearance._encoded(view)
        rule(renders[view], view, i, BufferPool())
        rule.appearance.learn(i)
    with torch.no_grad():
        return torch.stack([rule.appearance.encode(view)[1] for view in range(len(renders))]).numpy()


@pytest.mark.parametrize("price", [0.15, 0.5])
def test_a_free_mask_ends_at_the_closed_form(price):
    losses = torch.rand(12, 16, generator=torch.Generator().manual_seed(0)) * 0.5
    logits = torch.zeros(12, 16, requires_grad=True)
    adam = torch.optim.Adam([logits], 0.15)
    for _ in range(300):
        adam.zero_grad()
        visibility_loss(torch.sigmoid(logits), losses, price)[0].backward()
        adam.step()
    assert (torch.sigmoid(logits) - (1 - losses / (2 * price)).clamp(0, 1)).abs().max() < 0.02


def test_the_gradient_is_that_of_the_weighed_loss():
    visible = torch.rand(5, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    losses = np.random.default_rng(1).random((20, 27)).astype(np.float32)
    assert learn_visibility(visible, losses, 0.15).shape == losses.shape
    for place in ((0, 0), (2, 3), (4, 6)):
        step, wanted = torch.zeros(5, 7, dtype=torch.float64), torch.from_numpy(losses).double()
        step[place] = 1e-6
        above, below = (visibility_loss(visible.detach() + s * step, wanted, 0.15)[0].item() for s in (1, -1))
        assert visible.grad[place].item() == pytest.approx((above - below) / 2e-6, rel=1e-5)


def test_renders_are_compared_under_the_mask_once_it_has_begun():
    rule = objective(pictures(), replace(ALWAYS, visible_from=0.5))
    image, target = np.random.default_rng(2).random((HEIGHT, WIDTH, 3), np.float32), rule.target(1)
    rule.appearance._encoded(1)
    assert rule(image, 1, 49, BufferPool())[0] == photometric_loss(image, target)[0]
    assert rule.appearance.visible.grad is None
    loss, gradient = rule(image, 1, 50, BufferPool())
    expected, by_image = photometric_loss(image, target, weights=np.full((HEIGHT, WIDTH), 0.98, np.float32))
    assert loss == pytest.approx(expected, rel=1e-5)
    assert np.allclose(gradient, by_image, rtol=1e-4, atol=1e-9)
    assert rule.appearance.visible.grad.abs().sum() > 0


def test_the_mask_finds_what_is_not_of_the_scene_and_leaves_the_rest():
    pixels, hidden = pictures(), np.zeros((4, HEIGHT, WIDTH), bool)
    renders = pixels.astype(np.float32) / 255
    for view, (top, left) in enumerate([(4, 6), (20, 40), (10, 30), (24, 8)]):
        hidden[view, top : top + 16, left : left + 16] = True
    pixels[hidden] = 250
    masks = taught(objective(pixels), renders)
    rows = np.linspace(0, HEIGHT - 1, masks.shape[1]).round().astype(int)
    columns = np.linspace(0, WIDTH - 1, masks.shape[2]).round().astype(int)
    inside = hidden[:, rows][:, :, columns]
    assert masks[inside].mean() < 0.5
    assert masks[~inside].mean() > 0.7


def test_lpips_is_added_unmasked(monkeypatch):
    """With a stand-in for the network, whose gradient is known."""
    monkeypatch.setattr(
        "baselines.encoders.objective.lpips", lambda a, b, net, ignored: ((a - b) ** 2).mean(dim=(1, 2, 3))
    )
    image, photograph = np.random.default_rng(0).random((2, 8, 9, 3), np.float32)
    value, gradient = perceptual_loss(image, photograph)
    assert value == pytest.approx(np.mean((image - photograph) ** 2), rel=1e-5)
    assert np.allclose(gradient, 2 * (image - photograph) / image.size, atol=1e-7)
    rule = objective([np.round(255 * photograph).astype(np.uint8)], replace(SHORT, lpips=0.5))
    target = rule.target(0)
    expected = photometric_loss(image, target)[0] + 0.5 * np.mean((image - target.image) ** 2)
    assert rule(image, 0, 0, BufferPool())[0] == pytest.approx(expected, rel=1e-5)


RELATIVE = PriceConfig(price=3.5, relative=True)


def test_the_published_price_falls_with_visits_of_a_view():
    running, seen = Running(10, 1, 0.5), (torch.ones(4), torch.zeros(4), torch.ones(4, dtype=torch.bool))
    assert float(price_of_masking(PriceConfig(), running)) == pytest.approx(5e-2)
    for _ in range(20):
        running.observe(*seen)
    assert running.visits == 2
    assert float(price_of_masking(PriceConfig(), running)) == pytest.approx(5e-2 * math.exp(-1.5))
    for _ in range(30):
        running.observe(*seen)
    assert float(price_of_masking(PriceConfig(), running)) == pytest.approx(6e-3)  # e^(-3.75) would be 1.2e-3


def test_a_relative_price_follows_the_median_error_of_what_counts():
    running = Running(4, 2, 0.05)
    assert float(price_of_masking(RELATIVE, running)) == pytest.approx(3.5 * GREY)
    errors, m = torch.tensor([9.0, 0.02, 0.01, 0.04]), torch.tensor([1.0, 0.1, 0.2, 0.3])
    counts = torch.tensor([False, True, True, True])
    running.observe(errors, m, counts)
    kept = 0.5 ** (2 / 4)
    assert float(running.typical) == pytest.approx(kept * GREY + (1 - kept) * 0.02)
    assert float(running.masked) == pytest.approx(kept * 0.05 + (1 - kept) * 0.2)
    running.observe(errors, m, torch.zeros(4, dtype=torch.bool))  # nothing counts: nothing is learned of it
    assert float(running.typical) == pytest.approx(kept * GREY + (1 - kept) * 0.02)
    assert running.visits == 1
    for _ in range(200):
        running.observe(torch.zeros(4), m, counts)
    assert float(price_of_masking(RELATIVE, running)) == pytest.approx(3.5 * LEAST)  # masking never costs nothing


def test_masks_that_hide_the_scene_are_spoken_of_once_though_a_training_is_resumed(tmp_path, caplog):
    running, resumed = Running(4, 4, 0.9), Running(4, 4, 0.9)
    hiding = torch.full((4,), 0.1), torch.full((4,), 0.95), torch.ones(4, dtype=torch.bool)
    for said in (0, 0, 1, 1):  # at first it is too early to say
        running.observe(*hiding)
        assert len(caplog.messages) == said
    write_arrays(tmp_path / "state.safetensors", module_arrays(running), {})
    restore_module(resumed, read_arrays(tmp_path / "state.safetensors")[0])
    resumed.observe(*hiding)
    assert resumed.visits == 5
    assert len(caplog.messages) == 1
