"""RobustNeRF's filter, SpotLessSplats and DeSplat leave out what single photographs show; layers of views."""

import logging
from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import assert_found, disturbed, fitted, occluded
from splats import camera, photographed
from trainings import PLAIN, psnr

from baselines.distractors.desplat import SHORT_LAYERS, DeSplat, DeSplatConfig
from baselines.distractors.robust_filter import RobustFilter, RobustFilterConfig
from baselines.distractors.spotless import Spotless, SpotlessConfig
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
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.feature_network import MaskNetworkConfig
from baselines.masking.trimmed import TrimConfig
from baselines.method import check_hidden
from baselines.splatting.backends import torch_rasterizer
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import from_colour
from baselines.splatting.rasterizer import backward_sh_sets
from baselines.splatting.strategies.densification import DefaultStrategy

LONGER = replace(PLAIN, iterations=800, resolutions=((0.2, 2),))


@pytest.mark.parametrize(
    ("kind", "config", "side"),
    [
        (RobustFilter, RobustFilterConfig(PLAIN, TrimConfig(inlier_share=0.9)), 36),  # gains of seeds: 0.4 to 0.8
        (Spotless, SpotlessConfig(PLAIN, network=MaskNetworkConfig("vgg", rate=1e-2, prior=0.9)), 48),  # 0.4 to 1.7
    ],
)
def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path, kind, config, side):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded", size=side)
    plain = fitted(GaussianSplatting, PLAIN, shown, tmp_path / "plain")
    ours = fitted(kind, config, shown, tmp_path / "ours")
    assert psnr(ours, scene.test_views) > psnr(plain, scene.test_views) + 0.2
    assert "pixels" in ours.summary().used
    assert_found(ours, shown, scene)


def test_what_floats_before_each_camera_stays_in_its_layer(tmp_path):
    """A soft bright blob before every camera, each time elsewhere."""
    scene = photographed(tmp_path, n_views=16)
    y, x = np.mgrid[:36, :48]
    places = np.random.default_rng(0).uniform(0.25, 0.75, (16, 2)) * (36, 48)

    def behind(image, index):
        cover = 0.9 * np.exp(-(((y - places[index, 0]) ** 2 + (x - places[index, 1]) ** 2) / (2 * 7.0**2)))[..., None]
        return (1 - cover) * image + cover * np.array([1.0, 0.9, 0.1])

    shown = disturbed(scene, tmp_path / "floating", behind)
    config = DeSplatConfig(LONGER, replace(SHORT_LAYERS, number=60, cover_penalty=0.02))
    plain = fitted(GaussianSplatting, LONGER, shown, tmp_path / "plain")
    ours = fitted(DeSplat, config, shown, tmp_path / "desplat")
    assert psnr(ours, scene.test_views) > psnr(plain, scene.test_views) + 1
    assert "layers cover" in ours.summary().used
    hidden = ours.hidden(0, (36, 48))
    check_hidden(hidden, (36, 48))
    assert hidden.max() > 0.5
    assert plain.hidden(0, (36, 48)) is None
    assert ours.summary().n_primitives == len(ours._trained.gaussians)  # of the scene alone


@pytest.mark.parametrize(("opacity", "warnings"), [(0.1, 0), (0.95, 1)])
def test_layers_that_cover_everything_are_said(tmp_path, caplog, opacity, warnings):
    growth = replace(LayerConfig().growth, start=1, every=1, stop=9, budget=30, grow_grad2d=0)
    layers = LayerConfig(number=100, opacity=opacity, growth=growth)
    with caplog.at_level(logging.WARNING):
        fitted(DeSplat, DeSplatConfig(replace(LONGER, iterations=16), layers), photographed(tmp_path, 4), tmp_path)
    assert len([record for record in caplog.records if "layers hide" in record.getMessage()]) == warnings


VIEW = camera(24, 18)
LAYERS = LayerConfig(number=40, opacity=0.4)


def layer(config=LAYERS):
    return first_layer(VIEW, config, layer_stream(0, 0, 0))


def random(seed, *shape):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def test_a_new_layer_covers_the_picture_evenly():
    gaussians = layer(replace(LAYERS, number=4000)).gaussians
    depth = gaussians.means[:, 2]
    assert DEPTHS[0] <= depth.min() < depth.max() <= DEPTHS[1]
    pixels = gaussians.means[:, :2] / depth[:, None] * (VIEW.fx, VIEW.fy) + (VIEW.cx, VIEW.cy)
    assert ((pixels >= 0) & (pixels <= (VIEW.width, VIEW.height))).all()
    assert np.histogram2d(pixels[:, 0], pixels[:, 1], bins=(4, 3))[0].min() > 0.75 * 4000 / 12
    assert np.allclose(1 / (1 + np.exp(-gaussians.opacity_logits)), 0.4, atol=1e-6)


def test_composite_and_gradients_are_those_of_float64():
    state, scene, weights = layer(), random(0, 18, 24, 3), random(1, 18, 24, 3) - 0.5
    rendered = render_layer(state.gaussians, VIEW, BufferPool())
    parameters, below = torch_rasterizer.tensors(state.gaussians), torch.from_numpy(scene).double().requires_grad_()
    here, black = replace(VIEW, world_to_camera=np.eye(4)), torch.zeros(3, dtype=torch.float64)
    white = {**parameters, "sh": torch.from_numpy(from_colour(np.ones((LAYERS.number, 1, 3)))).double()}
    cover = torch_rasterizer.render(white, here, black, 0)[..., 0]
    expected = torch_rasterizer.render(parameters, here, black, 0) + (1 - cover[..., None]) * below
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
    config = replace(LAYERS, number=200, opacity=0.1, cover_penalty=0.001)
    state, buffers, scene = layer(config), BufferPool(), np.full((18, 24, 3), 0.3, np.float32)
    before = render_layer(state.gaussians, VIEW, BufferPool()).cover[:, 20:].mean()
    photograph = scene.copy()
    photograph[4:14, 6:16] = (0.9, 0.2, 0.1)
    for step in range(150):
        rendered = render_layer(state.gaussians, VIEW, buffers)
        grad = np.sign(composited(rendered, scene) - photograph) / scene.size
        state = learn(state, rendered, gradients_of(rendered, scene, grad, 0.001)[1], step / 150, config)
    assert state.iteration == 150
    rendered = render_layer(state.gaussians, VIEW, buffers)
    assert np.abs(composited(rendered, scene) - photograph).mean() < 0.05
    assert rendered.cover[7:11, 9:13].min() > 0.8
    assert rendered.cover[:, 20:].mean() < before / 2


def test_a_layer_grows_when_its_views_visits_say_so_and_may_become_empty():
    growth = DefaultStrategy(start=2, stop=9, every=2, budget=60, grow_grad2d=0, prune_scale3d=10.0, reset_every=None)
    config, scene = replace(LAYERS, growth=growth), random(0, 18, 24, 3)
    state = replace(layer(config), iteration=3)
    assert grown(state, 0, config, 0) is state
    state = replace(state, iteration=4, gradient_sum=np.ones(40, np.float32), seen=np.ones(40, np.float32))
    larger, again, other = (grown(state, view, config, 0) for view in (0, 0, 1))
    assert (len(larger.gaussians), larger.iteration) == (60, 4)
    assert np.array_equal(larger.gaussians.means, again.gaussians.means)
    assert not np.array_equal(larger.gaussians.means, other.gaussians.means)
    faint = replace(state, gaussians=replace(state.gaussians, opacity_logits=np.full(40, -9, np.float32)))
    empty = grown(faint, 0, config, 0)
    assert len(empty.gaussians) == 0
    rendered = render_layer(empty.gaussians, VIEW, BufferPool())
    assert np.array_equal(composited(rendered, scene), scene)
    by_scene, by_sets = gradients_of(rendered, scene, scene, 0.1)
    assert np.array_equal(by_scene, scene)
    assert learn(empty, rendered, by_sets, 0.5, config).iteration == 5
