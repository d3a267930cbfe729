"""GS-W: what it is for, its files, and colours of Gaussians, with the gradients of float64."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from looks import GROWING, all_grey
from splats import camera, cloud, photographed

from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT
from baselines.gs_w.fusion import Fusion
from baselines.gs_w.mean_appearance import average_features, coloured_for
from baselines.gs_w.method import GaussianInTheWild, GSWConfig
from baselines.splatting.appearance.gaussians import AppearanceGaussians, gaussians_in_view, with_appearance
from baselines.splatting.backends import torch_rasterizer
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.training.images import TrainingImages
from baselines.volumetric.fields.encodings import positional
from hydroviews.errors import InputError


def test_viewers_get_harmonics_as_they_are_and_a_network_of_other_settings_is_refused(tmp_path):
    config = GSWConfig(GROWING, SHORT)
    method = fitted(GaussianInTheWild, config, photographed(tmp_path, n_views=6), tmp_path)
    method.save(tmp_path)
    assert np.array_equal(read_ply(tmp_path / SPLATS).sh[:, 1:], method._trained.gaussians.sh[:, 1:])
    with pytest.raises(InputError, match="another network"):
        GaussianInTheWild.load(replace(config, appearance=replace(SHORT, fused=16)), 0, tmp_path)


def test_the_mean_appearance_is_that_of_the_views_where_they_agree(tmp_path):
    """With one reference for all adaptive maps to read, and no projection, the mean is what each view has."""
    scene = all_grey(photographed(tmp_path, n_views=6))
    method = fitted(GaussianInTheWild, GSWConfig(GROWING, replace(SHORT, dropout=0.0)), scene, tmp_path)
    appearance, trained = method._objective.appearance, method._trained
    cameras = [view.camera for view in scene.train_views]
    flat = appearance.encode(0)[0].detach().mean(dim=(1, 2), keepdim=True).expand(-1, 4, 4)
    appearance.encode = lambda view: (flat, None)
    parameters = replace(trained.gaussians, features=appearance.features(trained.gaussians))
    mean = average_features(parameters, appearance, cameras, trained.near, False)
    assert np.allclose(mean.features, flat[:, 0, 0].numpy(), atol=1e-5)
    appearance._encoded = lambda view: (flat, None)
    own = gaussians_in_view(parameters, appearance, cameras[1], 1, 1)
    assert np.allclose(coloured_for(mean, method._fusion, cameras[1]).sh, own.sh, atol=1e-4)


VIEW = camera(41, 30)


def appearance_of(absent=0.0):
    """The appearance of two pictures; without `absent` the reference is seen in every step."""
    pictures = np.random.default_rng(0).integers(0, 255, (2, 30, 41, 3)).astype(np.uint8)
    return ReferenceAppearance(TrainingImages(list(pictures)), replace(SHORT, absent=absent), 1, 10, 0)


def restless(appearance):
    """The same with a last layer that says something, and Gaussians for it."""
    torch.manual_seed(1)
    with torch.no_grad():
        appearance.fusion.colour[-1].weight.normal_(0, 0.1)
    return appearance, with_appearance(cloud(40, 1), appearance)


def test_the_first_look_has_the_points_colours():
    gaussians, appearance = cloud(50, 1), appearance_of(SHORT.absent)
    visible = AppearanceGaussians(with_appearance(gaussians, appearance), appearance, VIEW, 0, 1)
    assert np.array_equal(visible.sh[0], gaussians.sh[visible.rows])


def test_colours_are_what_the_layers_say_of_position_features_and_direction():
    appearance, gaussians = restless(appearance_of())
    parameters = {name: torch.from_numpy(value) for name, value in gaussians.state_dict().items()}
    dynamic, fusion, means = torch.rand(40, SHORT.dynamic), appearance.fusion, parameters["means"]
    found = fusion.coloured(parameters, VIEW, dynamic)
    intrinsic, offset = parameters["sh"].flatten(1), means - torch.from_numpy(VIEW.centre).float()
    fused = torch.cat([positional((means - fusion.middle) / fusion.side, SHORT.frequencies), dynamic, intrinsic], dim=1)
    fused = torch.cat([fusion.encoder(fused).relu(), intrinsic], dim=1)
    fused = torch.cat([fusion.decoder(fused).relu(), offset / offset.norm(dim=1, keepdim=True)], dim=1)
    assert torch.allclose(found[:, 0], parameters["sh"][:, 0] + fusion.colour(fused) / C0, atol=1e-5)
    assert torch.equal(found[:, 1:], parameters["sh"][:, 1:])
    assert (found[:, 0] - parameters["sh"][:, 0]).abs().max() > 0.01


def test_gradients_are_those_of_float64():
    """By features, coordinates, maps and all weights of the fusion network, through the way numpy takes."""
    appearance, gaussians = restless(appearance_of())
    visible = AppearanceGaussians(gaussians, appearance, VIEW, 1, 1)
    rows, upstream = visible.rows, cloud(40, 1, seed=5).select(visible.rows)
    ours = visible.backward(upstream, upstream.sh[None], BufferPool())

    twin = Fusion(SHORT, 1).double()
    twin.load_state_dict(appearance.fusion.state_dict())
    leaves = torch_rasterizer.tensors(gaussians)
    seen = {k: v[rows] for k, v in leaves.items()}
    maps = appearance.encode(1)[0].detach().double().requires_grad_()
    dynamic = appearance._dropped(appearance.read(maps, seen, VIEW))
    (twin.coloured(seen, VIEW, dynamic) * torch.from_numpy(upstream.sh).double()).sum().backward()
    for name in ("sh", "features"):
        expected = leaves[name].grad.numpy()
        assert np.abs(getattr(ours, name) - expected).max() < 1e-4 * np.abs(expected).max(), name
    assert torch.allclose(appearance._leaves[0].grad.double(), maps.grad, rtol=1e-3, atol=1e-4 * maps.grad.abs().max())
    for (name, weight), other in zip(appearance.fusion.named_parameters(), twin.parameters(), strict=True):
        assert (weight.grad - other.grad).abs().max() < 1e-4 * other.grad.abs().max(), name
    assert np.array_equal(ours.means[rows], upstream.means)  # colours add nothing to what positions are told


def test_in_some_steps_nothing_of_the_reference_is_seen():
    appearance, gaussians = restless(appearance_of(absent=0.4))
    same, moved = [], []
    for step in range(100):
        shown = [AppearanceGaussians(gaussians, appearance, VIEW, reference, 1) for reference in (0, 1)]
        same.append(np.array_equal(shown[0].sh, shown[1].sh))
        upstream = cloud(40, 1).select(shown[1].rows)
        moved.append(shown[1].backward(upstream, upstream.sh[None], BufferPool()).features.any())
        appearance.learn(step)
    assert same.count(True) == pytest.approx(40, abs=15)
    assert moved == [not alike for alike in same]  # a step without the reference teaches nothing of where to look
    with torch.no_grad():
        assert not any(appearance._absent() for _ in range(20))
