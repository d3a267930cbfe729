"""NeRF-W, Ha-NeRF and CR-NeRF keep out of the scene what single photographs have of their own."""

from dataclasses import replace

import balls
import numpy as np
import pytest
from ball_methods import CR_NERF, HA_NERF
from disturbed import behind_squares, disturbed, fitted, held_out, only_in_training

from baselines.cr_nerf.method import CrNerf
from baselines.ha_nerf.method import HaNerf
from baselines.nerf_w import NerfW, NerfWConfig

NERF_W = NerfWConfig(balls.SHORT, transient_width=16, embedding_rate=3e-3)


@pytest.mark.parametrize(("kind", "config"), [(HaNerf, HA_NERF), (CrNerf, CR_NERF)])
def test_an_occluder_in_a_third_of_the_views_is_kept_out(ball, plain, tmp_path, kind, config):
    scene = behind_squares(ball, tmp_path)
    without = held_out(plain(balls.Plain, config.volumetric, scene), scene)
    ours = held_out(fitted(kind, config, scene, tmp_path / "ours"), scene)
    assert ours > without + 1, (ours, without)


@pytest.mark.parametrize(("kind", "config"), [(HaNerf, replace(HA_NERF, volumetric=balls.SHORT)), (CrNerf, CR_NERF)])
def test_colour_casts_of_the_views_are_kept_out(ball_in_casts, plain, tmp_path, kind, config):
    methods = plain(balls.Plain, balls.SHORT, ball_in_casts), fitted(kind, config, ball_in_casts, tmp_path)
    without, ours = (held_out(method, ball_in_casts, gains=True) for method in methods)
    assert ours > without + 1.5, (ours, without)


def test_nerf_w_keeps_out_casts_and_occluders_at_once(ball, plain, tmp_path):
    """Patches of any colour, which are nowhere else."""
    rng = np.random.default_rng(0)

    def change(picture, index):
        picture = picture * rng.uniform(0.3, 1.0, 3)
        if index % 3 == 1:
            top, left = rng.integers(0, 12), rng.integers(0, 20)
            picture[top : top + 12, left : left + 12] = rng.uniform(0, 1, 3)
        return picture

    scene = disturbed(ball, tmp_path, only_in_training(ball, change))
    methods = plain(balls.Plain, balls.SHORT, scene), fitted(NerfW, NERF_W, scene, tmp_path / "ours")
    without, ours = (held_out(method, scene, gains=True) for method in methods)
    assert ours > without + 2, (ours, without)
