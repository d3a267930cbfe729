"""Means over views, and linear layers of parts, against what they are by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import camera, cloud

from baselines.splatting.appearance.networks import linear_of_parts
from baselines.splatting.appearance.view_averages import mean_over_views


def test_a_view_counts_for_as_much_as_it_shows_of_a_gaussian():
    far, near = camera(40, 30, 0.0, origin=(4, 0, 0)), camera(40, 30, 0.0)
    means = np.array([[0, 0, 0], [0, 0, 90]], np.float32)  # the second is in sight of none
    ball = replace(
        cloud(2, 0),
        means=means,
        log_scales=np.full((2, 3), np.log(0.2), np.float32),
        quaternions=np.tile(np.array([1, 0, 0, 0], np.float32), (2, 1)),
        opacity_logits=np.full(2, 2, np.float32),
    )
    asked = []

    def values(view, local, seen):
        asked.append((view, len(seen["means"])))
        return torch.full((len(seen["means"]), 2), float(view)) * torch.tensor([1.0, 10.0])

    found = mean_over_views(ball, [far, near], values, 0.01, False, torch.device("cpu"), "numbers")
    assert asked == [(0, 1), (1, 1)]
    # Twice as near shows four times as many pixels, but for what a splat is widened by.
    assert 0.75 < found[0, 0] < 0.81
    assert np.allclose(found[:, 1], 10 * found[:, 0])
    assert np.allclose(found[1], found[0])


def test_what_is_hidden_does_not_count():
    cameras = camera(40, 30, 0.0), camera(40, 30, np.pi)  # in front and behind
    pair = replace(
        cloud(2, 0),
        means=np.array([[1.5, 0, 0], [-1.5, 0, 0]], np.float32),
        log_scales=np.log(np.array([[0.8] * 3, [0.1] * 3], np.float32)),
        opacity_logits=np.full(2, 9, np.float32),
    )

    def values(view, local, seen):
        return torch.full((len(seen["means"]), 1), float(view))

    found = mean_over_views(pair, cameras, values, 0.01, False, torch.device("cpu"), "numbers")
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
