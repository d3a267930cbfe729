"""RobustNeRF's filter, SpotLessSplats and DeSplat leave out of the scene what single photographs show before it."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from disturbed import assert_found, disturbed, fitted, occluded
from splats import photographed
from trainings import psnr

from baselines.distractors.desplat import SHORT_LAYERS, DeSplat, DeSplatConfig
from baselines.distractors.robust_filter import RobustFilter, RobustFilterConfig
from baselines.distractors.spotless import Spotless, SpotlessConfig
from baselines.distractors.view_layers import LayerConfig
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.feature_network import MaskNetworkConfig
from baselines.masking.trimmed import TrimConfig
from baselines.method import check_hidden
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy

GROWTH = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=400, sh_degree=0, strategy=GROWTH, device="cpu")
LONGER = replace(SPLATTING, iterations=800, resolutions=((0.2, 2),))


@pytest.mark.parametrize(
    ("kind", "config", "side"),
    [
        (RobustFilter, RobustFilterConfig(SPLATTING, TrimConfig(inlier_share=0.9)), 36),  # gains of seeds: 0.4 to 0.8
        (Spotless, SpotlessConfig(SPLATTING, network=MaskNetworkConfig("vgg", rate=1e-2, prior=0.9)), 48),  # 0.4 to 1.7
    ],
)
def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path, kind, config, side):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded", size=side)
    plain = psnr(fitted(GaussianSplatting, SPLATTING, shown, tmp_path / "plain"), scene.test_views)
    ours = fitted(kind, config, shown, tmp_path / "ours")
    assert psnr(ours, scene.test_views) > plain + 0.2
    assert "pixels" in ours.summary().used
    assert_found(ours, shown, scene)


def floating(scene, folder, seed=0):
    """A soft bright blob before every camera, each time elsewhere."""
    height, width = scene.views[0].camera.height, scene.views[0].camera.width
    y, x = np.mgrid[:height, :width]
    places = np.random.default_rng(seed).uniform(0.25, 0.75, (len(scene.views), 2)) * (height, width)

    def behind(image, index):
        cover = 0.9 * np.exp(-(((y - places[index, 0]) ** 2 + (x - places[index, 1]) ** 2) / (2 * 7.0**2)))[..., None]
        return (1 - cover) * image + cover * np.array([1.0, 0.9, 0.1])

    return disturbed(scene, folder, behind)


def test_what_floats_before_each_camera_stays_in_its_layer(tmp_path):
    scene = photographed(tmp_path, n_views=16)
    shown = floating(scene, tmp_path / "floating")
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
