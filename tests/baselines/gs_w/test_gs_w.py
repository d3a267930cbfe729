"""GS-W as a method: what it is for, its files, resumption, and the profiles."""

from dataclasses import replace

import numpy as np
import pytest
from disturbed import fitted
from looks import GROWING, SPLATTING, held_out, true_pictures
from splats import photographed

from baselines.gaussian_splatting import GaussianSplatting
from baselines.gs_w.config import SHORT
from baselines.gs_w.mean_appearance import average_features, coloured_for
from baselines.gs_w.method import GaussianInTheWild, GSWConfig
from baselines.method import check_hidden
from baselines.splatting.appearance.gaussians import gaussians_in_view
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.rasterizer import render
from hydroviews.errors import InputError
from hydroviews.metrics.psnr import psnr
from hydroviews.scene.images import write_png

BRIEF = replace(SHORT, rate_maps=2e-3, rate_colour=2e-3)  # for a tenth of the iterations


def test_a_colour_cast_a_view_is_told_from_the_scene(things, things_in_casts, plain, tmp_path):
    scene, truth = things_in_casts, true_pictures(things)
    without = plain(GaussianSplatting, SPLATTING, scene)
    appearance = fitted(GaussianInTheWild, GSWConfig(SPLATTING, BRIEF), scene, tmp_path)
    assert held_out(appearance, scene, truth) > held_out(without, scene, truth) + 0.5


def test_colours_for_viewers_and_a_network_of_other_settings(tmp_path):
    scene = photographed(tmp_path, n_views=6, width=37, height=29)
    config = GSWConfig(GROWING, SHORT)
    method = fitted(GaussianInTheWild, config, scene, tmp_path)
    method.save(tmp_path)
    check_hidden(method.hidden(0, (29, 37)), (29, 37))
    assert GaussianInTheWild.load(config, 0, tmp_path).hidden(0, (29, 37)) is None  # references are not saved
    shown = read_ply(tmp_path / SPLATS)
    assert np.array_equal(shown.sh[:, 1:], method._trained.gaussians.sh[:, 1:])
    camera = scene.train_views[0].camera
    assert psnr(np.clip(render(shown, camera)[0], 0, 1), method.render(camera)) > 25
    other = replace(config, appearance=replace(SHORT, fused=16))
    with pytest.raises(InputError, match="another network"):
        GaussianInTheWild.load(other, 0, tmp_path)


def test_the_mean_appearance_is_that_of_the_views_where_they_agree(tmp_path):
    """With one reference for all adaptive maps to read, and no projection, the mean is what each view has."""
    scene = photographed(tmp_path, n_views=6)
    for view in scene.train_views:
        write_png(view.path, np.full((36, 48, 3), 0.4, np.float32))
    method = fitted(GaussianInTheWild, GSWConfig(GROWING, replace(SHORT, dropout=0.0)), scene, tmp_path)
    appearance, trained = method._objective.appearance, method._trained
    cameras = [view.camera for view in scene.train_views]
    flat = appearance.encode(0)[0].detach().mean(dim=(1, 2), keepdim=True).expand(-1, 4, 4)
    appearance.encode = lambda view: (flat, None)
    coordinates = appearance.features(trained.gaussians)
    parameters = replace(trained.gaussians, features=coordinates)
    mean = average_features(parameters, appearance, cameras, trained.near, False)
    assert np.allclose(mean.features, flat[:, 0, 0].numpy(), atol=1e-5)
    appearance._encoded = lambda view: (flat, None)
    own = gaussians_in_view(parameters, appearance, cameras[1], 1, 1)
    assert np.allclose(coloured_for(mean, method._fusion, cameras[1]).sh, own.sh, atol=1e-4)
