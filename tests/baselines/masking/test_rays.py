"""What masking costs: how the price follows visits and errors."""

import math

import pytest
import torch

from baselines.masking.rays import GREY, LEAST, PriceConfig, Running, price_of_masking
from baselines.training.checkpoints import read_arrays, write_arrays
from baselines.training.torch_state import module_arrays, restore_module

RELATIVE = PriceConfig(price=3.5, relative=True)


def test_the_published_price_falls_with_visits_of_a_view():
    running = Running(10, 1, 0.5)
    assert float(price_of_masking(PriceConfig(), running)) == pytest.approx(5e-2)
    seen = torch.ones(4), torch.zeros(4), torch.ones(4, dtype=torch.bool)
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
    running = Running(4, 4, 0.9)
    hiding = torch.full((4,), 0.1), torch.full((4,), 0.95), torch.ones(4, dtype=torch.bool)
    for _ in range(2):
        running.observe(*hiding)
    assert not caplog.messages  # too early to say
    running.observe(*hiding)
    running.observe(*hiding)
    assert len(caplog.messages) == 1
    write_arrays(tmp_path / "state.safetensors", module_arrays(running), {})
    resumed = Running(4, 4, 0.9)
    restore_module(resumed, read_arrays(tmp_path / "state.safetensors")[0])
    resumed.observe(*hiding)
    assert resumed.visits == 5
    assert len(caplog.messages) == 1
