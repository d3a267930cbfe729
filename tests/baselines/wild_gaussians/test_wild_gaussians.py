from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import assert_found, disturbed, fitted, occluded
from looks import hides_everything_and_says_so
from splats import photographed
from trainings import psnr

import baselines.wild_gaussians.method as wild
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.uncertainty import UncertaintyConfig
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.wild_gaussians.appearance import AppearanceConfig
from baselines.wild_gaussians.method import WildConfig, WildGaussians

GROWTH = DefaultStrategy(
    start=10, stop=150, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=240, sh_degree=0, strategy=GROWTH, device="cpu")
QUICK_APPEARANCE = AppearanceConfig(width=16, scale=0.3, rate=5e-3, view_rate=2e-2)
CONFIG = WildConfig(
    SPLATTING, QUICK_APPEARANCE, UncertaintyConfig("alexnet", start=60, warm_up=20, protected=0, rate=1e-2, every=2)
)
BRIEF = replace(CONFIG, splatting=replace(SPLATTING, iterations=16, checkpoint_seconds=0.0), sky=50)


def test_a_colour_cast_in_every_view_is_taken_off(tmp_path):
    scene = photographed(tmp_path, n_views=16)
    casts = np.random.default_rng(0).uniform(0.6, 1.0, (16, 3))
    casts /= casts.mean(axis=0) / 0.8
    cast = disturbed(scene, tmp_path / "cast", lambda image, index: image * casts[index])
    truth = disturbed(scene, tmp_path / "truth", lambda image, _: image * 0.8).test_views  # in the mean of all light
    config = replace(CONFIG, uncertainty=None)
    plain = psnr(fitted(GaussianSplatting, SPLATTING, cast, tmp_path / "plain"), truth)
    toned = psnr(fitted(WildGaussians, config, cast, tmp_path / "toned"), truth)
    assert toned > plain + 1.5


class Blocks:
    """Stands in for AlexNet, which sees too far for pictures this small: mean colours of 8x8 pixels, and a constant."""

    name, alike, unlike = "blocks", 0.02, 0.3

    def __call__(self, image):
        planes = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)
        mean = torch.nn.functional.avg_pool2d(planes, 8) - 0.4
        return torch.cat([mean, torch.full_like(mean[:1], 0.15)])


def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path, monkeypatch):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded")
    steady = replace(SPLATTING, iterations=400, strategy=DefaultStrategy(start=1000))
    off = replace(CONFIG, splatting=steady, appearance=None, uncertainty=None)
    taught = UncertaintyConfig(
        "alexnet", start=80, warm_up=20, protected=0, first_lesson=30, rate=2e-2, prior=0.6, least=0.5
    )
    monkeypatch.setattr(wild, "calibrated", lambda *_: Blocks())
    without = psnr(fitted(WildGaussians, off, shown, tmp_path / "off"), scene.test_views)
    told = fitted(WildGaussians, replace(off, uncertainty=taught), shown, tmp_path / "on")
    assert psnr(told, scene.test_views) > without + 0.8
    assert_found(told, shown, scene)


def test_the_loss_is_l1_of_the_toned_look_and_ssim_of_the_plain_one(tmp_path):
    scene = photographed(tmp_path, n_views=4)
    images = wild.read_images(scene.train_views)
    plain, photograph = (np.random.default_rng(k).random((36, 48, 3)).astype(np.float32) for k in range(2))
    exact = images.pixels(0) / np.float32(255)
    ours, usual = wild.WildObjective(images, 0.2, None, None), Objective(images)
    reference = usual(photograph, 0, 0, BufferPool())
    same = ours.compare([photograph, photograph], 0, 0, BufferPool())
    assert same[0] == pytest.approx(reference[0], rel=1e-5)
    assert np.allclose(sum(same[1]), reference[1], atol=1e-8)
    loss, (toned, other) = ours.compare([exact, plain], 0, 0, BufferPool())
    assert not toned.any()
    assert loss == pytest.approx(0.2 * Objective(images, 1.0)(plain, 0, 0, BufferPool())[0], rel=1e-5)
    assert other.any()


def test_masks_that_hide_everything_are_said(tmp_path, caplog):
    uncertain = replace(BRIEF.uncertainty, start=0, warm_up=0, prior=2.0)
    hides_everything_and_says_so(WildGaussians, replace(BRIEF, uncertainty=uncertain), tmp_path, caplog)
