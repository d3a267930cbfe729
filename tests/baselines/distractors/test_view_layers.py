"""Layers against their closed form and float64 gradients."""

from dataclasses import replace

import numpy as np
import torch
from splats import camera

from baselines.distractors.view_layers import (
    DEPTHS,
    LayerConfig,
    composited,
    first_layer,
    gradients_of,
    grown,
    layer_stream,
    learn,
    render_layer,
)
from baselines.splatting.backends import torch_rasterizer
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import from_colour
from baselines.splatting.rasterizer import backward_sh_sets
from baselines.splatting.strategies.densification import DefaultStrategy

VIEW = camera(24, 18)
CONFIG = LayerConfig(number=40, opacity=0.4)


def layer(config=CONFIG, view=VIEW):
    return first_layer(view, config, layer_stream(0, 0, 0))


def random(seed, *shape):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def in_float64(parameters, scene):
    """C and A_d of the composite, by the slow renderer."""
    here = replace(VIEW, world_to_camera=np.eye(4))
    black = torch.zeros(3, dtype=torch.float64)
    white = {**parameters, "sh": torch.from_numpy(from_colour(np.ones((len(parameters["sh"]), 1, 3)))).double()}
    colour = torch_rasterizer.render(parameters, here, black, 0)
    cover = torch_rasterizer.render(white, here, black, 0)[..., 0]
    return colour + (1 - cover[..., None]) * scene, cover


def test_a_new_layer_covers_the_picture_evenly():
    gaussians = layer(replace(CONFIG, number=4000)).gaussians
    depth = gaussians.means[:, 2]
    assert DEPTHS[0] <= depth.min() < depth.max() <= DEPTHS[1]
    pixels = gaussians.means[:, :2] / depth[:, None] * (VIEW.fx, VIEW.fy) + (VIEW.cx, VIEW.cy)
    assert pixels.min() >= 0
    assert (pixels.max(axis=0) <= (VIEW.width, VIEW.height)).all()
    counts = np.histogram2d(pixels[:, 0], pixels[:, 1], bins=(4, 3))[0]
    assert counts.min() > 0.75 * 4000 / 12
    assert np.allclose(1 / (1 + np.exp(-gaussians.opacity_logits)), 0.4, atol=1e-6)


def test_composite_and_gradients_are_those_of_float64():
    state, scene, weights = layer(), random(0, 18, 24, 3), random(1, 18, 24, 3) - 0.5
    rendered = render_layer(state.gaussians, VIEW, BufferPool())
    parameters = torch_rasterizer.tensors(state.gaussians)
    below = torch.from_numpy(scene).double().requires_grad_()
    expected, cover = in_float64(parameters, below)
    assert np.allclose(composited(rendered, scene), expected.detach(), atol=1e-5)
    assert np.allclose(rendered.cover, cover.detach(), atol=1e-5)
    ((expected * torch.from_numpy(weights)).sum() + 0.3 * cover.mean()).backward()
    by_scene, by_sets = gradients_of(rendered, scene, weights, 0.3)
    assert np.allclose(by_scene, below.grad, atol=1e-5)
    found = backward_sh_sets(rendered.state, by_sets)[0].parameters
    for name in FIELDS:
        exact = parameters[name].grad.numpy()
        assert np.abs(getattr(found, name) - exact).max() < 2e-3 * max(np.abs(exact).max(), 1e-3), name


def test_a_layer_learns_what_lies_before_the_scene():
    config = replace(CONFIG, number=200, opacity=0.1, cover_penalty=0.001)
    state, buffers = layer(config), BufferPool()
    before = render_layer(state.gaussians, VIEW, BufferPool()).cover[:, 20:].mean()
    scene = np.full((18, 24, 3), 0.3, np.float32)
    photograph = scene.copy()
    photograph[4:14, 6:16] = (0.9, 0.2, 0.1)
    for step in range(150):
        rendered = render_layer(state.gaussians, VIEW, buffers)
        grad = np.sign(composited(rendered, scene) - photograph) / scene.size
        state = learn(state, rendered, gradients_of(rendered, scene, grad, 0.001)[1], step / 150, config)
    rendered = render_layer(state.gaussians, VIEW, buffers)
    assert np.abs(composited(rendered, scene) - photograph).mean() < 0.05
    assert rendered.cover[7:11, 9:13].min() > 0.8
    assert rendered.cover[:, 20:].mean() < before / 2
    assert state.iteration == 150


def test_a_layer_grows_when_its_views_visits_say_so_and_may_become_empty():
    growth = DefaultStrategy(start=2, stop=9, every=2, budget=60, grow_grad2d=0, prune_scale3d=10.0, reset_every=None)
    config = replace(CONFIG, growth=growth)
    state = replace(layer(config), iteration=3)
    assert grown(state, 0, config, 0) is state
    state = replace(state, iteration=4, gradient_sum=np.ones(40, np.float32), seen=np.ones(40, np.float32))
    larger = grown(state, 0, config, 0)
    assert len(larger.gaussians) == 60
    assert larger.iteration == 4
    draws = [grown(state, view, config, 0).gaussians.means for view in (0, 0, 1)]
    assert np.array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])
    faint = replace(state, gaussians=replace(state.gaussians, opacity_logits=np.full(40, -9, np.float32)))
    empty = grown(faint, 0, config, 0)
    assert len(empty.gaussians) == 0
    scene = random(0, 18, 24, 3)
    rendered = render_layer(empty.gaussians, VIEW, BufferPool())
    assert np.array_equal(composited(rendered, scene), scene)
    by_scene, by_sets = gradients_of(rendered, scene, scene, 0.1)
    assert np.array_equal(by_scene, scene)
    assert learn(empty, rendered, by_sets, 0.5, config).iteration == 5
