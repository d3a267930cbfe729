"""GS-W: what it is for, its files, and colours of Gaussians, with the gradients of float64."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from looks import GROWING, SPLATTING, held_out, true_pictures
from splats import camera, cloud, photographed

from baselines.gaussian_splatting import GaussianSplatting
from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT
from baselines.gs_w.fusion import Fusion
from baselines.gs_w.mean_appearance import average_features, coloured_for
from baselines.gs_w.method import GaussianInTheWild, GSWConfig
from baselines.method import check_hidden
from baselines.splatting.appearance.gaussians import AppearanceGaussians, gaussians_in_view, with_appearance
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.splatting.rasterizer import render
from baselines.training.images import TrainingImages
from baselines.volumetric.fields.encodings import positional
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


SEEING = replace(SHORT, absent=0.0)  # the reference in every step


def some_pictures(count=2, height=30, width=41):
    return TrainingImages(list(np.random.default_rng(0).integers(0, 255, (count, height, width, 3)).astype(np.uint8)))


def restless(appearance):
    """The same with a last layer that says something."""
    torch.manual_seed(1)
    with torch.no_grad():
        appearance.fusion.colour[-1].weight.normal_(0, 0.1)
    return appearance


def test_the_first_look_has_the_points_colours():
    gaussians, appearance = cloud(50, 1), ReferenceAppearance(some_pictures(), SHORT, 1, 10, 0)
    visible = AppearanceGaussians(with_appearance(gaussians, appearance), appearance, camera(41, 30), 0, 1)
    assert np.array_equal(visible.sh[0], gaussians.sh[visible.rows])


def test_colours_are_what_the_layers_say_of_position_features_and_direction():
    gaussians, view = cloud(30, 1), camera(41, 30)
    appearance = restless(ReferenceAppearance(some_pictures(), SHORT, 1, 10, 0))
    gaussians = with_appearance(gaussians, appearance)
    parameters = {name: torch.from_numpy(value) for name, value in gaussians.state_dict().items()}
    dynamic = torch.rand(30, SHORT.dynamic)
    found = appearance.fusion.coloured(parameters, view, dynamic)
    fusion, means = appearance.fusion, parameters["means"]
    intrinsic, offset = parameters["sh"].flatten(1), means - torch.from_numpy(view.centre).float()
    fused = torch.cat([positional((means - fusion.middle) / fusion.side, SHORT.frequencies), dynamic, intrinsic], dim=1)
    fused = torch.cat([fusion.encoder(fused).relu(), intrinsic], dim=1)
    fused = torch.cat([fusion.decoder(fused).relu(), offset / offset.norm(dim=1, keepdim=True)], dim=1)
    assert torch.allclose(found[:, 0], parameters["sh"][:, 0] + fusion.colour(fused) / C0, atol=1e-5)
    assert torch.equal(found[:, 1:], parameters["sh"][:, 1:])
    assert (found[:, 0] - parameters["sh"][:, 0]).abs().max() > 0.01


def test_gradients_are_those_of_float64():
    """By features, coordinates, maps and all weights of the fusion network, through the way numpy takes."""
    gaussians, view = cloud(40, 1), camera(41, 30)
    appearance = restless(ReferenceAppearance(some_pictures(), SEEING, 1, 10, 0))
    gaussians = with_appearance(gaussians, appearance)
    visible = AppearanceGaussians(gaussians, appearance, view, 1, 1)
    rows, upstream = visible.rows, cloud(40, 1, seed=5).select(visible.rows)
    ours = visible.backward(upstream, upstream.sh[None], BufferPool())

    twin = Fusion(SHORT, 1).double()
    twin.load_state_dict(appearance.fusion.state_dict())
    leaves = {k: torch.from_numpy(v).double().requires_grad_() for k, v in gaussians.state_dict().items()}
    seen = {k: v[rows] for k, v in leaves.items()}
    maps = appearance.encode(1)[0].detach().double().requires_grad_()
    dynamic = appearance._dropped(appearance.read(maps, seen, view))
    (twin.coloured(seen, view, dynamic) * torch.from_numpy(upstream.sh).double()).sum().backward()
    for name in ("sh", "features"):
        expected = leaves[name].grad.numpy()
        assert np.abs(getattr(ours, name) - expected).max() < 1e-4 * np.abs(expected).max(), name
    assert torch.allclose(appearance._leaves[0].grad.double(), maps.grad, rtol=1e-3, atol=1e-4 * maps.grad.abs().max())
    for (name, weight), other in zip(appearance.fusion.named_parameters(), twin.parameters(), strict=True):
        assert (weight.grad - other.grad).abs().max() < 1e-4 * other.grad.abs().max(), name
    assert np.array_equal(ours.means[rows], upstream.means)  # colours add nothing to what positions are told


def test_in_some_steps_nothing_of_the_reference_is_seen():
    appearance = restless(ReferenceAppearance(some_pictures(), replace(SHORT, absent=0.4), 1, 10, 0))
    gaussians, view = with_appearance(cloud(40, 1), appearance), camera(41, 30)
    same, moved = [], []
    for step in range(100):
        shown = [AppearanceGaussians(gaussians, appearance, view, reference, 1) for reference in (0, 1)]
        same.append(np.array_equal(shown[0].sh, shown[1].sh))
        upstream = cloud(40, 1).select(shown[1].rows)
        moved.append(shown[1].backward(upstream, upstream.sh[None], BufferPool()).features.any())
        appearance.learn(step)
    assert same.count(True) == pytest.approx(40, abs=15)
    assert moved == [not alike for alike in same]  # a step without the reference teaches nothing of where to look
    with torch.no_grad():
        assert not any(appearance._absent() for _ in range(20))
