"""Methods of radiance fields: what they keep out of the scene, and that they go on on another card."""

from dataclasses import replace

import balls
import numpy as np
import pytest
import torch
from ball_methods import CR_NERF, HA_NERF
from balls import SMALL, photographed
from disturbed import behind_squares, disturbed, fitted, held_out, only_in_training
from pretended_gpu import NAME
from splats import camera

from baselines.cr_nerf.config import CrNerfConfig, StyleConfig, TransformConfig, TransientConfig
from baselines.cr_nerf.method import CrNerf
from baselines.ha_nerf.config import HaNerfConfig, LookConfig, VisibilityConfig
from baselines.ha_nerf.method import HaNerf
from baselines.nerf_w import NerfW, NerfWConfig
from baselines.occ_nerf.config import OccNerfConfig
from baselines.occ_nerf.method import OccNerf
from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.trainer import FieldTrainer

BRIEF = replace(SMALL, iterations=4, rays=32, proposal_samples=8, samples=4, checkpoint_seconds=0.0)
LOOKS = LookConfig(size=8, channels=(8, 8, 8), side=24), VisibilityConfig(code=8, octaves=2, width=8, layers=1)
STYLES = (
    StyleConfig(channels=(8, 8, 8), side=24),
    TransformConfig(size=8, hidden=(8,)),
    TransientConfig(channels=8, dilations=(1,), side=24),
)
METHODS = {
    "plain": (RadianceMethod, BRIEF),
    "nerf-w": (NerfW, NerfWConfig(BRIEF, transient_width=8)),
    "ha-nerf": (HaNerf, HaNerfConfig(BRIEF, *LOOKS, photographs=2)),
    "cr-nerf": (CrNerf, CrNerfConfig(BRIEF, 8, *STYLES, photographs=2)),
    "occ-nerf": (OccNerf, OccNerfConfig(BRIEF, BRIEF.field, alone=0.3)),
}


@pytest.mark.parametrize("name", METHODS)
def test_a_field_trains_goes_on_on_another_card_and_comes_back(pretended_gpu, tmp_path, monkeypatch, name):
    def lost(trainer):
        if trainer.iteration == 2 and not cards:
            cards.append("another card")
            raise KeyboardInterrupt
        return step(trainer)

    step, cards = FieldTrainer.step, []
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda")
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda *_: (cards or [NAME])[0])
    monkeypatch.setattr(FieldTrainer, "step", lost)
    (kind, config), folder = METHODS[name], tmp_path / "run"
    scene = photographed(tmp_path / "scene", n_views=8)
    with pytest.raises(KeyboardInterrupt):
        fitted(kind, config, scene, folder)
    method = fitted(kind, config, scene, folder)
    method.save(folder)
    picture = method.render(camera(12, 8))
    assert np.isfinite(picture).all()
    assert (method.summary().device, method.summary().render_device) == ("another card", "another card")

    assert np.array_equal(kind.load(config, 0, folder).render(camera(12, 8)), picture)
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cpu")
    summary = kind.load(config, 0, folder).summary()
    assert (summary.device, summary.render_device) == ("another card", "cpu")


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
    rng, config = np.random.default_rng(0), NerfWConfig(balls.SHORT, transient_width=16, embedding_rate=3e-3)

    def change(picture, index):
        picture = picture * rng.uniform(0.3, 1.0, 3)
        if index % 3 == 1:
            top, left = rng.integers(0, 12), rng.integers(0, 20)
            picture[top : top + 12, left : left + 12] = rng.uniform(0, 1, 3)
        return picture

    scene = disturbed(ball, tmp_path, only_in_training(ball, change))
    methods = plain(balls.Plain, balls.SHORT, scene), fitted(NerfW, config, scene, tmp_path / "ours")
    without, ours = (held_out(method, scene, gains=True) for method in methods)
    assert ours > without + 2, (ours, without)
