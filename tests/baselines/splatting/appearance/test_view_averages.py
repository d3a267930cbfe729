"""Means over views against what they are by hand."""

from dataclasses import replace

import numpy as np
import torch
from splats import camera, cloud

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
    front, behind = camera(40, 30, 0.0), camera(40, 30, np.pi)
    pair = replace(
        cloud(2, 0),
        means=np.array([[1.5, 0, 0], [-1.5, 0, 0]], np.float32),
        log_scales=np.log(np.array([[0.8] * 3, [0.1] * 3], np.float32)),
        opacity_logits=np.full(2, 9, np.float32),
    )
    found = mean_over_views(
        pair,
        [front, behind],
        lambda view, local, seen: torch.full((len(seen["means"]), 1), float(view)),
        0.01,
        False,
        torch.device("cpu"),
        "numbers",
    )
    assert found[1, 0] > 0.95  # the large one hides it from the front
    assert 0.05 < found[0, 0] < 0.95
