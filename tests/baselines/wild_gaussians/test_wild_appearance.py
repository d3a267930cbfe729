from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import BACKGROUND, camera, cloud

from baselines.splatting.appearance.gaussians import AppearanceGaussians, with_appearance
from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.rasterizer import backward_sh_sets, render_sh_sets
from baselines.wild_gaussians.appearance import MIDDLE, AppearanceConfig, WildAppearance, toned
from baselines.wild_gaussians.mean_appearance import mean_appearance
from baselines.wild_gaussians.sky import Bounds

BOUNDS = Bounds(np.zeros(3), 1.5)
LIVELY = AppearanceConfig(width=16, scale=1.0)


def appearance(views=3, config=LIVELY, seed=0):
    return WildAppearance(views, BOUNDS, 100, config, seed)


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_toned_coefficients_are_toned_colours(degree):
    generator = torch.Generator().manual_seed(degree)
    sh = torch.randn(20, (degree + 1) ** 2, 3, generator=generator, dtype=torch.float64)
    gain, offset = (torch.randn(20, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    directions = torch.nn.functional.normalize(torch.randn(20, 3, generator=generator, dtype=torch.float64), dim=1)
    basis = reference.basis(degree, directions)

    def colour(coefficients):
        return MIDDLE + (basis[:, :, None] * coefficients).sum(dim=1)

    assert torch.allclose(colour(toned(sh, gain, offset)), gain * colour(sh) + offset, atol=1e-12)


def test_gradients_are_those_of_float64():
    ours, twin = appearance(), appearance().double()
    gaussians, view = with_appearance(cloud(40, 1), ours), camera(24, 20)
    weights = [np.random.default_rng(k).normal(size=(20, 24, 3)).astype(np.float32) for k in range(2)]
    visible = AppearanceGaussians(gaussians, ours, view, 1, 1)
    gradients, by_sh_sets = backward_sh_sets(
        render_sh_sets(visible.gaussians, visible.sh, view, BACKGROUND)[1], np.stack(weights)
    )
    found = visible.backward(gradients.parameters, by_sh_sets, BufferPool())

    leaves = {name: torch.from_numpy(v).double().requires_grad_() for name, v in gaussians.state_dict().items()}
    background = torch.from_numpy(BACKGROUND).double()
    loss = sum(
        (reference.render({**leaves, "sh": sh}, view, background, 1, 0.01) * torch.from_numpy(weight)).sum()
        for sh, weight in zip(twin.sh_sets(leaves, view, 1, 1), weights, strict=True)
    )
    loss.backward()
    for name in ("sh", "features", "means"):
        expected = leaves[name].grad.numpy()
        assert np.abs(getattr(found, name) - expected).max() < 2e-3 * np.abs(expected).max(), name
    for (name, mine), other in zip(ours.named_parameters(), twin.parameters(), strict=True):
        assert (mine.grad - other.grad).abs().max() < 2e-3 * other.grad.abs().max(), name
    assert ours.views.grad[1].any()
    assert not ours.views.grad[[0, 2]].any()


def test_gaussians_look_as_in_the_mean_of_the_views_that_show_them():
    model, cameras = appearance(), [camera(24, 20, angle) for angle in (0.0, 0.05, np.pi)]
    cameras[2] = camera(24, 20, np.pi, origin=(30, 0, 0))  # looks at something else
    gaussians = with_appearance(
        replace(cloud(3, 1, size=0.05), means=np.array([[0, 0, 0], [30, 0, 0], [0, 90, 0]], "f")), model
    )
    shown = mean_appearance(gaussians, model, cameras, 0.01, antialiased=False)
    assert shown.features is None
    parameters = {name: torch.from_numpy(value) for name, value in gaussians.state_dict().items()}
    with torch.no_grad():
        colours = [model.sh_sets(parameters, view, k, 1)[0].numpy() for k, view in enumerate(cameras)]
    assert np.allclose(shown.sh[0], (colours[0][0] + colours[1][0]) / 2, atol=5e-3)  # as large in both
    assert np.allclose(shown.sh[1], colours[2][1], atol=1e-5)
    assert np.abs(shown.sh[2] - gaussians.sh[2]).max() > 0.05  # seen nowhere: toned as all are in the mean
    assert np.abs(colours[0][0] - colours[1][0]).max() > 0.02


def test_it_starts_from_the_colours_as_they_are():
    model = appearance(config=AppearanceConfig())
    gaussians = with_appearance(cloud(40, 1), model)
    cameras = [camera(24, 20, angle) for angle in (0, 2, 4)]
    assert np.abs(mean_appearance(gaussians, model, cameras, 0.01, antialiased=False).sh - gaussians.sh).max() < 0.02
