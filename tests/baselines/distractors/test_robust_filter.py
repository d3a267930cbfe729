from dataclasses import replace

import pytest
from disturbed import assert_found, fitted, occluded
from splats import photographed
from trainings import psnr

from baselines.distractors.robust_filter import RobustFilter, RobustFilterConfig
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.trimmed import TrimConfig
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from hydroviews.errors import InputError

GROWTH = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=400, sh_degree=0, strategy=GROWTH, device="cpu")


def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded", size=36)
    config = RobustFilterConfig(SPLATTING, TrimConfig(inlier_share=0.9))
    plain = psnr(fitted(GaussianSplatting, SPLATTING, shown, tmp_path / "plain"), scene.test_views)
    robust = fitted(RobustFilter, config, shown, tmp_path / "robust")
    assert psnr(robust, scene.test_views) > plain + 0.2  # seeds: 0.4 to 0.8
    assert_found(robust, shown, scene)


def test_a_checkpoint_made_with_other_settings_of_the_weights_is_refused(tmp_path):
    scene, brief = photographed(tmp_path, n_views=3), replace(SPLATTING, iterations=2)
    fitted(RobustFilter, RobustFilterConfig(brief), scene, tmp_path / "run")
    with pytest.raises(InputError, match=r"a different configuration[\s\S]*inlier_share"):
        fitted(RobustFilter, RobustFilterConfig(brief, TrimConfig(inlier_share=0.8)), scene, tmp_path / "run")
