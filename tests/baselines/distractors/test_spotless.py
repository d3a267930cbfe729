from dataclasses import replace

from disturbed import (
    assert_found,
    fitted,
    occluded,
)
from splats import photographed
from trainings import psnr

from baselines.distractors.spotless import Spotless, SpotlessConfig
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.feature_network import MaskNetworkConfig
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy

STEADY = DefaultStrategy(start=1000, stop=1001, reset_every=None)
GROWTH = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=400, sh_degree=0, strategy=STEADY, device="cpu")
NETWORK = MaskNetworkConfig("vgg", rate=1e-2, prior=0.9)
CONFIG = SpotlessConfig(SPLATTING, network=NETWORK)


def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded")
    splatting = replace(SPLATTING, strategy=GROWTH)
    plain = psnr(fitted(GaussianSplatting, splatting, shown, tmp_path / "plain"), scene.test_views)
    ours = fitted(Spotless, replace(CONFIG, splatting=splatting), shown, tmp_path / "spotless")
    assert psnr(ours, scene.test_views) > plain + 0.2  # seeds: 0.4 to 1.7
    assert "features vgg, pixels" in ours.summary().used
    assert_found(ours, shown, scene)
