"""Occlusion-free NeRF: which loss moves what and when, the cases that break it, and that it sees past occluders."""

import logging
from dataclasses import replace

import balls
import numpy as np
import pytest
import torch
import wall
from disturbed import fitted
from field_rays import SPACE, rays

from baselines.method import check_hidden
from baselines.occ_nerf.config import OccNerfConfig
from baselines.occ_nerf.losses import occ_nerf_losses
from baselines.occ_nerf.method import OccNerf
from baselines.occ_nerf.model import OccNerfModel
from baselines.volumetric.config import MlpFieldConfig
from baselines.volumetric.model import TrainingContext
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.rays import camera_rays

VOLUMETRIC = replace(balls.SMALL, iterations=180)
CONFIG = OccNerfConfig(VOLUMETRIC, VOLUMETRIC.field, gap=0.35, alone=0.1, depth_weight=0.1)
COUNT = 40


def model():
    """Untrained, but with something in every cell of its grids."""
    generator = torch.Generator().manual_seed(0)
    made = OccNerfModel(CONFIG, SPACE, generator)
    with torch.no_grad():
        for part in (made.field, made.background, made.proposal):
            part.grid.tables.uniform_(-1, 1, generator=generator)
    return made


def batch(**changes):
    given = {"colours": torch.full((COUNT, 3), 0.4), "weights": torch.ones(COUNT), "views": torch.arange(COUNT) % 3}
    return Batch(rays(COUNT), **(given | changes))


def rendered(field, progress=1.0):
    return field(rays(COUNT), TrainingContext(torch.arange(COUNT) % 3, torch.full((2, COUNT), 0.5), progress=progress))


def losses_of(field, of, progress=1.0):
    return occ_nerf_losses(CONFIG)(rendered(field, progress), of)


def decided(field, foreground):
    """A model whose detector says the same of every ray."""
    with torch.no_grad():
        field.detector.layers[-1].weight.zero_()
        field.detector.layers[-1].bias.fill_(9.0 if foreground else -9.0)
    return field


@pytest.mark.parametrize(
    ("name", "moves"),
    [
        ("colour", "field"),
        ("detector", "detector"),
        ("interlevel", "proposal"),
        ("background interlevel", "proposal"),
        ("background", "background"),
        ("depth", "background"),
    ],
)
def test_each_loss_moves_its_own_part_alone(name, moves):
    field = decided(model(), foreground=False)
    losses_of(field, batch())[name].backward()
    for part in ("field", "background", "proposal", "detector"):
        gradients = [p.grad.abs().sum() for p in getattr(field, part).parameters() if p.grad is not None]
        assert (sum(gradients) > 0) == (part == moves), part


def filled(field, density):
    """A field of one density everywhere."""
    with torch.no_grad():
        field.outer.weight[0].zero_()
        field.outer.bias[0] = np.log(density)


def test_the_background_is_learned_after_the_share_in_which_the_others_are_alone():
    field = model()
    early, late = (losses_of(field, batch(), progress) for progress in (CONFIG.alone - 1e-3, CONFIG.alone))
    assert set(early) == {"colour", "detector", "interlevel"}
    assert set(late) == {*early, "background", "depth", "background interlevel"}
    assert (early["detector"] / late["detector"]).item() == pytest.approx(3, rel=1e-4)


def test_losses_are_those_of_the_formulas():
    with torch.no_grad():
        rendering = rendered(model())
    rendering.extras["foreground"] = torch.rand(COUNT, generator=torch.Generator().manual_seed(1))
    losses, extras = occ_nerf_losses(CONFIG)(rendering, batch()), rendering.extras
    kept = (extras["foreground"] < 0.5).float()
    assert 0.1 < float(kept.mean()) < 0.9
    error = (extras["background_colour"] - 0.4).square().mean(1)
    apart = (extras["background_depth"] - extras["depth"]).abs()
    cosine = torch.nn.functional.cosine_similarity(extras["foreground"] - 0.5, extras["gap"] - CONFIG.gap, dim=0)
    assert losses["background"].item() == pytest.approx(2 * (kept * error).mean().item())
    assert losses["depth"].item() == pytest.approx(CONFIG.depth_weight * (kept * apart).mean().item())
    assert losses["detector"].item() == pytest.approx(0.01 * (1 - cosine.item()), rel=1e-3)


def test_everything_taken_for_foreground_is_said_once_and_not_followed(caplog):
    field, loss = decided(model(), foreground=True), occ_nerf_losses(CONFIG)
    with caplog.at_level(logging.WARNING):
        first, _ = (loss(rendered(field), batch()) for _ in range(2))
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "takes 100.0 % of the rays for foreground" in caplog.text
    assert torch.equal(first["background"], losses_of(decided(field, foreground=False), batch())["background"])


@pytest.mark.parametrize("density", [1e-12, 1.0, 1e12], ids=["empty", "fog", "saturated"])
@pytest.mark.parametrize("counts", [0.0, 1.0], ids=["masked", "all count"])
@pytest.mark.parametrize("foreground", [False, True])
def test_losses_and_gradients_stay_finite(density, counts, foreground):
    field = decided(model(), foreground)
    filled(field.field, density)
    filled(field.background, density)
    rendering = rendered(field)
    seen = batch(colours=rendering.colour.detach().clone(), weights=torch.full((COUNT,), counts))
    losses = occ_nerf_losses(CONFIG)(rendering, seen)
    sum(losses.values()).backward()
    assert all(torch.isfinite(term) for term in losses.values())
    assert all(torch.isfinite(p.grad).all() for p in field.parameters() if p.grad is not None)


def test_what_is_shown_is_the_background_alone():
    field = model()
    with torch.no_grad():
        shown = field(rays(COUNT)).colour
        field.field.exit.bias.add_(3.0)
        filled(field.field, 50.0)
        decided(field, foreground=True)
        assert torch.equal(field(rays(COUNT)).colour, shown)
        field.background.exit.bias.add_(3.0)
        assert not torch.allclose(field(rays(COUNT)).colour, shown, atol=1e-3)


def test_networks_of_the_paper_are_rendered_at_the_samples_of_both_passes(tmp_path):
    small = MlpFieldConfig(width=16, depth=3, position_octaves=3)
    volumetric = replace(balls.SMALL, iterations=6, anneal=10, field=small, proposal_samples=12, samples=10, rays=32)
    config = OccNerfConfig(volumetric, replace(small, depth=4))
    method = fitted(OccNerf, config, wall.photographed(tmp_path), tmp_path)
    assert method.render(wall.camera(0, 0)).shape == (wall.HEIGHT, wall.WIDTH, 3)


@pytest.fixture(scope="module")
def occluded(tmp_path_factory):
    return wall.photographed(tmp_path_factory.mktemp("occluded"))


@pytest.fixture(scope="module")
def trained(occluded, tmp_path_factory):
    return fitted(OccNerf, CONFIG, occluded, tmp_path_factory.mktemp("trained"))


def test_what_stands_close_before_the_cameras_is_seen_past(occluded, trained, tmp_path):
    methods = fitted(balls.Plain, VOLUMETRIC, occluded, tmp_path), trained
    plain, ours = (balls.psnr(method.render, occluded.test_views) for method in methods)
    assert ours > plain + 1.5, (plain, ours)


def test_the_posts_are_found(occluded, trained):
    planes, hidden, size = [], [], (wall.HEIGHT, wall.WIDTH)
    for index, view in enumerate(occluded.train_views):
        m = trained.model.foreground(trained.model.space.from_world(camera_rays(view.camera), torch.device("cpu")))
        planes.append(trained.hidden(index, size))
        hidden.append(wall.occluded(*view.camera.centre[:2]).reshape(size))
        check_hidden(planes[-1], size)
        assert np.array_equal(planes[-1], m.numpy().reshape(size))
    found, posts = np.array(planes) >= 0.5, np.array(hidden)
    assert found[posts].mean() > 0.5
    assert found[~posts].mean() < 0.1
    assert "foreground" in trained.summary().used
