"""What Gaussians contribute to views, and removal of those that contribute least."""

from dataclasses import replace

import numpy as np
import pytest
from splats import camera, cloud, with_values
from trainings import BUDGETED, CONFIG, assert_identical

from baselines.splatting.config import Pruning
from baselines.splatting.rasterizer import render
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.pruning import contributions, prune
from baselines.splatting.trainer import train

CAMERAS = [camera(60, 40, angle) for angle in (0.0, 2.0, 4.0)]


def test_weights_add_up_to_what_is_covered():
    gaussians = with_values(cloud(200, 2), "sh", slice(0, 50), -9)  # black ones: colours clamped at zero
    weights = contributions(gaussians, CAMERAS, 0.01)
    covered = sum(float((1 - render(gaussians, one)[1].transmittance).sum()) for one in CAMERAS)
    assert weights.sum() == pytest.approx(covered, rel=1e-4)
    assert (weights >= 0).all()


def test_a_weight_is_what_the_image_changes_by_with_the_colour():
    gaussians = cloud(30, 0)
    weights = contributions(gaussians, CAMERAS[:1], 0.01)
    gaussians.sh[:] = 1
    before = render(gaussians, CAMERAS[0])[0].astype(np.float64).sum()
    for index in np.argsort(-weights)[:5]:
        brighter = with_values(gaussians, "sh", index, gaussians.sh[index] + 1)
        change = render(brighter, CAMERAS[0])[0].astype(np.float64).sum() - before
        assert weights[index] == pytest.approx(change / (3 * 0.28209479), rel=1e-3)


@pytest.mark.parametrize(
    ("pruning", "kept"),
    [
        (Pruning(share=0.4), [0, 2, 4]),
        (Pruning(), range(5)),
        (Pruning(budget=3), [0, 2, 4]),
        (Pruning(budget=3, share=0.8), [4]),
        (Pruning(budget=9), range(5)),
    ],
)
def test_the_smallest_weights_go_with_all_that_is_known_of_them(pruning, kept):
    state = fresh_state(cloud(5, 1))
    state.first.means[:] = np.arange(5)[:, None]
    state.seen[:] = np.arange(5)
    after = prune(state, np.array([5.0, 0.0, 1.5, 1.0, 9.0]), pruning)
    assert after.seen.tolist() == after.first.means[:, 0].tolist() == list(kept)
    assert np.array_equal(after.gaussians.sh, state.gaussians.sh[list(kept)])


@pytest.mark.parametrize("config", [CONFIG, BUDGETED], ids=["densification", "relocation"])
def test_a_trained_scene_is_pruned(scene, tmp_path, config):
    whole = train(scene, config, 0, tmp_path / "whole")
    config = replace(config, pruning=Pruning(at=(0.8,), share=0.3))
    pruned = train(scene, config, 0, tmp_path / "pruned")
    assert len(pruned.gaussians) == len(whole.gaussians) - int(0.3 * len(whole.gaussians))
    assert_identical(pruned, train(scene, config, 0, tmp_path / "pruned"))

    views, black = scene.train_views, np.zeros(3, np.float32)
    errors = []
    for trained in (whole, pruned):
        images = [render(trained.gaussians, view.camera, black, near=trained.near)[0] for view in views]
        errors.append(np.mean([np.abs(i - v.image()).mean() for i, v in zip(images, views, strict=True)]))
    assert errors[1] < 1.5 * errors[0]
