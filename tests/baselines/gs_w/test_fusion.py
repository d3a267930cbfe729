"""Colours of Gaussians: those of the points at first, with the gradients of float64."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import camera, cloud

from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT
from baselines.gs_w.fusion import Fusion
from baselines.splatting.appearance.gaussians import AppearanceGaussians, with_appearance
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.training.images import TrainingImages
from baselines.volumetric.fields.encodings import positional

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
