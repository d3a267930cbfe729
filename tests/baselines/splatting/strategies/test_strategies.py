"""Relocation within a budget, and removal of what contributes least to views."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import camera, cloud, with_values
from thread_counts import assert_same_on_two_threads
from trainings import BUDGETED, CONFIG, DENSIFY, assert_identical

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.backends.torch_ops import penalty_gradient, position_moves
from baselines.splatting.config import Pruning
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.mcmc import GATE
from baselines.splatting.rasterizer import render
from baselines.splatting.state import fresh_state, opacities
from baselines.splatting.strategies.base import PositionNoise, StepOptions
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.pruning import contributions, prune
from baselines.splatting.strategies.relocation import (
    PAPER_EXTENT,
    MCMCStrategy,
    add_noise,
    add_penalties,
    draw,
    grow,
    relocate,
    shared,
)
from baselines.splatting.trainer import train
from baselines.splatting_profiles import pruned_to_budget
from hydroviews.scene.quaternions import rotation_matrices


def generator():
    return np.random.default_rng(0)


def with_moments(gaussians):
    state = replace(fresh_state(gaussians), iteration=1)
    for moments in (state.first, state.second):
        for value in moments.state_dict().values():
            value[:] = 1
    return state


@pytest.mark.parametrize("n", [1, 2, 3, 10, 51])
@pytest.mark.parametrize("opacity", [0.006, 0.3, 0.9, 0.999])
def test_equation_9_is_the_papers_double_sum(opacity, n):
    new = 1 - (1 - opacity) ** (1 / n)
    total = sum(
        math.comb(i - 1, k) * (-1) ** k / np.sqrt(k + 1) * new ** (k + 1) for i in range(1, n + 1) for k in range(i)
    )
    assert np.allclose(np.ravel(shared(np.array([opacity]), np.array([n]))), (new, opacity / total), rtol=1e-9)


def test_copies_look_like_their_source():
    one = with_values(with_values(cloud(1, 0, size=0.3), "opacity_logits", 0, 1.0), "means", 0, 0)
    copies = grow(fresh_state(one), MCMCStrategy(budget=3, growth=3.0), generator()).gaussians
    assert len(copies) == 3
    before, after, naive = (render(g, camera(80, 60))[0] for g in (one, copies, one.select(np.zeros(3, int))))
    assert np.abs(after - before).mean() < 0.25 * np.abs(naive - before).mean()


def test_the_dead_move_to_the_live_in_proportion_to_opacity():
    gaussians = with_values(cloud(3000, 1), "opacity_logits", slice(None), -10)
    gaussians = with_values(gaussians, "opacity_logits", [0, 1, 2], np.log([0.2 / 0.8, 0.6 / 0.4, 0.006 / 0.994]))
    state = relocate(with_moments(gaussians), MCMCStrategy(), generator())
    after = state.gaussians
    sources = [int((after.means == gaussians.means[i]).all(axis=1).sum()) for i in range(3)]
    assert sum(sources) == len(after) == 3000
    assert sources[1] / sources[0] == pytest.approx(3, rel=0.15)
    assert (opacities(after) >= 0.005 * (1 - 1e-6)).all()
    moved = (after.means == gaussians.means[1]).all(axis=1)
    assert np.ptp(after.opacity_logits[moved]) == 0
    assert (after.log_scales[moved] < gaussians.log_scales[1]).all()
    assert not any(value[moved].any() for value in state.first.state_dict().values())


def test_who_gave_no_copy_keeps_values_and_moments():
    gaussians = with_values(cloud(5, 1), "opacity_logits", slice(None), [2.0, 2.0, 2.0, 2.0, -10.0])
    state = relocate(with_moments(gaussians), MCMCStrategy(), generator())
    source = int(np.flatnonzero((state.gaussians.means[:4] == state.gaussians.means[4]).all(axis=1))[0])
    for i in range(4):
        same = all(np.array_equal(getattr(state.gaussians, name)[i], getattr(gaussians, name)[i]) for name in FIELDS)
        assert same == (i != source)
        assert all(value[i].all() == (i != source) for value in state.second.state_dict().values())
    assert not any(value[4].any() for value in state.second.state_dict().values())


@pytest.mark.parametrize(("budget", "expected"), [(1000, 105), (103, 103), (50, 100)])
def test_growth_is_five_percent_up_to_the_budget(budget, expected):
    state = grow(with_moments(cloud(100, 1)), MCMCStrategy(budget=budget), generator())
    assert len(state.gaussians) == len(state.first) == len(state.seen) == expected


def test_copies_may_be_spread_around_their_source():
    one = with_values(cloud(1, 0), "opacity_logits", 0, 1.0)
    copies = grow(fresh_state(one), MCMCStrategy(budget=4001, growth=4000.0, spread=0.5), generator()).gaussians
    distances = copies.means - one.means[0]
    axes = rotation_matrices(copies.quaternions[:1])[0] * np.exp(copies.log_scales[0])
    expected = 0.25 * axes @ axes.T
    assert not distances[0].any()
    assert np.abs(np.cov(distances[1:].T) - expected).max() < 0.1 * np.abs(expected).max()


def test_more_points_than_the_budget_lose_the_most_transparent():
    gaussians = cloud(100, 1)
    state = MCMCStrategy(budget=60, dead=0.0).refine(with_moments(gaussians), 1.0, 0)
    assert np.array_equal(state.gaussians.means, gaussians.means[np.sort(np.argsort(gaussians.opacity_logits)[40:])])
    assert len(state.first) == len(state.seen) == 60


def test_nothing_alive_and_nothing_at_all():
    dead = with_values(cloud(10, 0), "opacity_logits", slice(None), -20)
    assert relocate(fresh_state(dead), MCMCStrategy(), generator()).gaussians is dead
    assert len(MCMCStrategy().refine(with_moments(cloud(0, 0)), 1.0, 0).gaussians) == 0
    assert draw(np.array([0.0, 1, 0]), 50, generator()).tolist() == [1] * 50


def test_noise_is_covariance_times_normal_noise_gated_by_opacity():
    gaussians = cloud(200, 0)
    gaussians.opacity_logits[:] = np.linspace(-9, 3, 200)
    before = {name: torch.from_numpy(value.copy()).double() for name, value in gaussians.state_dict().items()}
    drawn = PositionNoise(100.0, np.random.default_rng(5))
    add_noise(gaussians, drawn, np.empty((200, 3), np.float32))
    normal = np.random.default_rng(5).standard_normal((200, 3), np.float32)
    moved, shown = gaussians.means - before["means"].numpy(), opacities(gaussians)
    assert np.allclose(moved, position_moves(before, drawn, torch.from_numpy(normal).double()), rtol=1e-4, atol=1e-6)
    assert (np.linalg.norm(moved, axis=1)[shown < 1 - GATE] > 0.05).mean() > 0.8
    assert np.abs(moved[shown > 0.3]).max() < 1e-6


def test_penalties_are_gradients_of_mean_opacity_and_mean_scale():
    gaussians = cloud(50, 1)
    step_options, gradients = StepOptions(opacity_penalty=0.3, scale_penalty=0.7), gaussians.zeros()
    add_penalties(gaussians, step_options, gradients)
    values = reference.tensors(gaussians)
    (0.3 * values["opacity_logits"].sigmoid().mean() + 0.7 * values["log_scales"].exp().mean()).backward()
    for name in ("opacity_logits", "log_scales"):
        assert np.allclose(getattr(gradients, name), values[name].grad.numpy(), rtol=1e-5)
        assert torch.allclose(penalty_gradient(name, values[name].detach(), step_options), values[name].grad)
    assert not gradients.means.any()


def test_other_units_are_trained_the_same_way():
    one, other = (MCMCStrategy().step_options(7, 1e-4 * s, PAPER_EXTENT * s, 0) for s in (1.0, 10.0))
    assert one.noise.factor == pytest.approx(5e5 * 1e-4)
    assert other.noise.factor == pytest.approx(one.noise.factor / 10)  # times a covariance 100 times as large
    assert other.scale_penalty == pytest.approx(one.scale_penalty / 10)


def test_steps_do_not_depend_on_the_number_of_threads():
    def steps():
        gaussians, gradients = cloud(1000, 1), cloud(1000, 1).zeros()
        step_options = StepOptions(opacity_penalty=0.1, scale_penalty=0.1, noise=PositionNoise(10.0, generator()))
        add_penalties(gaussians, step_options, gradients)
        add_noise(gaussians, step_options.noise, np.empty((1000, 3), np.float32))
        return gaussians.means, gradients.log_scales, gradients.opacity_logits

    assert_same_on_two_threads(steps)


def test_a_budget_is_exceeded_early_and_kept_in_the_end(scene, tmp_path, monkeypatch):
    config = pruned_to_budget(100, replace(CONFIG, strategy=replace(DENSIFY, stop=120)))
    sizes, refine = [], DefaultStrategy.refine

    def watched(strategy, state, extent, seed):
        refined = refine(strategy, state, extent, seed)
        sizes.append(len(refined.gaussians))
        return refined

    monkeypatch.setattr(DefaultStrategy, "refine", watched)
    trained = train(scene, config, 0, tmp_path)
    assert trained.iterations == 2 * CONFIG.iterations
    assert max(sizes) > 100 == len(trained.gaussians)


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

    def light(sh):
        return render(replace(gaussians, sh=sh), CAMERAS[0])[0].astype(np.float64).sum()

    for index in np.argsort(-weights)[:5]:
        brighter = with_values(gaussians, "sh", index, 2)
        change = light(brighter.sh) - light(gaussians.sh)
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

    def error(trained):
        black = np.zeros(3, np.float32)
        images = [render(trained.gaussians, v.camera, black, near=trained.near)[0] for v in scene.train_views]
        return np.mean([np.abs(i - v.image()).mean() for i, v in zip(images, scene.train_views, strict=True)])

    assert error(pruned) < 1.5 * error(whole)
