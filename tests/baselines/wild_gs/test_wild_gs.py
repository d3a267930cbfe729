"""Wild-GS as a method: what it is for, what it survives, its files, resumption, and the profiles."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from looks import BRIEF, GROWING, SPLATTING, cast, held_out, true_pictures, whole
from splats import cloud, photographed

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import check_hidden
from baselines.splatting.appearance.gaussians import gaussians_in_view
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.splatting.rasterizer import render
from baselines.wild_gs.config import SHORT
from baselines.wild_gs.mean_look import mean_look
from baselines.wild_gs.method import WildGS, WildGSConfig
from baselines.wild_gs.triplane import CHANNELS
from hydroviews.scene.images import write_png

# Where light differs and nothing comes and goes: masks would take casts for that.
LIGHT = replace(BRIEF, absent=0.0, visible_from=2.0)


def things_lit():
    """What `photographed` shows, and which of it stands under a lamp of its own."""
    things = cloud(60, degree=0, seed=3, size=0.15)
    return things, things.means[:, 0] > 0


def cast_on_a_part(scene):
    """One half of the scene's things under a lamp that shines otherwise in every photograph."""
    rng, (things, lit) = np.random.default_rng(2), things_lit()
    for view in scene.train_views:
        colours = np.maximum(0.5 + C0 * things.sh[:, 0], 0).astype(np.float32)
        colours[lit] *= np.exp(rng.normal(-0.5, 0.4, 3)).astype(np.float32)
        write_png(view.path, np.clip(render(things.coloured(colours), view.camera)[0], 0, 1))


def lit_or_not(camera):
    """Where a picture shows things under the lamp, and where it does not [2, H, W]."""
    things, lit = things_lit()
    white = np.repeat(np.where(lit, np.float32(1), np.float32(0))[:, None], 3, axis=1)
    under = render(things.coloured(white), camera)[0][..., 0] > 0.5
    return np.stack([under, ~under])


@pytest.mark.parametrize(("spoilt", "parts"), [(cast, whole), (cast_on_a_part, lit_or_not)])
def test_light_that_differs_is_told_from_the_scene(tmp_path, spoilt, parts):
    scene = photographed(tmp_path)
    truth = true_pictures(scene)
    spoilt(scene)
    plain = fitted(GaussianSplatting, SPLATTING, scene, tmp_path / "plain")
    look = fitted(WildGS, WildGSConfig(SPLATTING, LIGHT), scene, tmp_path / "wild")
    assert held_out(look, scene, truth, parts) > held_out(plain, scene, truth, parts) + 0.5


def test_viewers_see_the_mean_look_and_references_are_not_saved(tmp_path):
    scene = photographed(tmp_path, n_views=6, width=37, height=29)
    config = WildGSConfig(GROWING, SHORT)
    method = fitted(WildGS, config, scene, tmp_path)
    method.save(tmp_path)
    check_hidden(method.hidden(0, (29, 37)), (29, 37))
    assert WildGS.load(config, 0, tmp_path).hidden(0, (29, 37)) is None
    camera = scene.test_views[0].camera
    shown = render(read_ply(tmp_path / SPLATS), camera, near=method._trained.near)[0]
    assert np.abs(np.clip(shown, 0, 1) - method.render(camera)).max() < 1e-5


@pytest.fixture
def alike(tmp_path):
    """A method taught with photographs of one colour, its Gaussians with their features, and its cameras."""
    scene = photographed(tmp_path, n_views=6)
    for view in scene.train_views:
        write_png(view.path, np.full((36, 48, 3), 0.4, np.float32))
    method = WildGS(WildGSConfig(GROWING, replace(BRIEF, absent=0.0)), 0)
    appearance = method.objective(scene, tmp_path).appearance
    gaussians = cloud(80, 1)
    torch.manual_seed(0)
    with torch.no_grad():
        appearance.colours.colour[-1].weight.normal_(0, 0.1)
    features = np.random.default_rng(0).normal(size=appearance.features(gaussians).shape).astype(np.float32)
    return appearance, replace(gaussians, features=features), [view.camera for view in scene.train_views]


def test_the_mean_look_is_that_of_the_views_where_they_agree(alike, monkeypatch):
    appearance, gaussians, cameras = alike

    def places(view, visible, parameters, camera):
        """What lies where, whoever looks."""
        return parameters["means"].detach().repeat(1, 6)[:, :CHANNELS]

    monkeypatch.setattr(appearance, "read", places)
    mean = mean_look(gaussians, appearance, cameras, 0.1, False)
    appearance._steps = appearance.iterations
    own = gaussians_in_view(gaussians, appearance, cameras[1], 1, 1)
    rows = [int(np.flatnonzero((mean.means == position).all(axis=1))[0]) for position in own.means]
    assert np.allclose(mean.sh[rows], own.sh, atol=1e-5)
    assert np.abs(mean.sh - gaussians.sh).max() > 0.05
    assert mean.features is None
