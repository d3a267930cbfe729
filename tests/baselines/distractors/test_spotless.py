from dataclasses import replace

import pytest
from disturbed import (
    NOTHING_IN_COMMON,
    assert_found,
    fitted,
    learns_of_nothing_in_common,
    occluded,
    whole_and_resumed,
)
from splats import photographed
from trainings import psnr

import baselines.distractors.spotless as spotless
from baselines.distractors.mask_network import MaskNetworkConfig
from baselines.distractors.spotless import Spotless, SpotlessConfig, SpotlessPruned
from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import find_method
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.utilisation import UtilisationPruning
from hydroviews.errors import InputError

STEADY = DefaultStrategy(start=1000, stop=1001, reset_every=None)
GROWTH = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=400, sh_degree=0, strategy=STEADY, device="cpu")
NETWORK = MaskNetworkConfig("vgg", rate=1e-2, prior=0.9)
CONFIG = SpotlessConfig(SPLATTING, network=NETWORK)
BRIEF = replace(CONFIG, splatting=replace(SPLATTING, iterations=16, checkpoint_seconds=0.0))


def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded")
    splatting = replace(SPLATTING, strategy=GROWTH)
    plain = psnr(fitted(GaussianSplatting, splatting, shown, tmp_path / "plain"), scene.test_views)
    ours = fitted(Spotless, replace(CONFIG, splatting=splatting), shown, tmp_path / "spotless")
    assert psnr(ours, scene.test_views) > plain + 0.2  # seeds: 0.4 to 1.7
    assert "features vgg, pixels" in ours.summary().used
    assert_found(ours, shown, scene)


def test_an_interrupted_run_ends_with_the_same_bits(tmp_path):
    scene = photographed(tmp_path, n_views=8)
    whole_and_resumed(Spotless, BRIEF, scene, tmp_path, spotless, "SpotlessObjective")
    with pytest.raises(InputError, match="checkpoint is of another run"):
        fitted(Spotless, replace(BRIEF, network=replace(NETWORK, width=8)), scene, tmp_path / "cut")


@pytest.mark.parametrize("change", NOTHING_IN_COMMON)
@pytest.mark.parametrize("n_views", [1, 6])
def test_views_that_have_nothing_in_common_leave_a_finite_scene(tmp_path, change, n_views):
    learns_of_nothing_in_common(Spotless, BRIEF, tmp_path, change, n_views)


def test_more_than_a_third_of_the_gaussians_are_pruned_by_their_use_and_renders_stay_close(tmp_path):
    scene = photographed(tmp_path, n_views=8)
    whole, pruned = (
        fitted(kind, replace(CONFIG, splatting=replace(SPLATTING, strategy=GROWTH, pruning=p)), scene, tmp_path / name)
        for kind, p, name in (
            (Spotless, None, "whole"),
            (SpotlessPruned, SpotlessPruned.configuration("demo").splatting.pruning, "pruned"),
        )
    )
    assert 1 / 3 < pruned.summary().n_primitives / whole.summary().n_primitives < 2 / 3
    assert psnr(pruned, scene.test_views) > psnr(whole, scene.test_views) - 0.5
    for profile in ("demo", "quick", "paper"):
        splatting = SpotlessPruned.configuration(profile).splatting
        assert isinstance(splatting.pruning, UtilisationPruning)
        assert splatting.strategy.stop <= min(splatting.pruning.at) * splatting.iterations  # nothing grows back


def test_the_method_is_found_and_sees_what_its_profile_says():
    assert find_method("spotless") is Spotless
    networks = {name: Spotless.configuration(name).network for name in ("demo", "quick", "paper")}
    assert [network.features for network in networks.values()] == ["vgg", "vgg", "dinov2"]
    assert networks["paper"] == MaskNetworkConfig()  # the authors' numbers
    limited = Spotless.with_max_iterations(Spotless.configuration("demo"), 20)
    assert limited.splatting.iterations == 20
