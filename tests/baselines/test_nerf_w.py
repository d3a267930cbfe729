"""NeRF-W: its compositing and loss in the cases that break them, and that its mechanism does what it is for."""

import balls
import numpy as np
import pytest
import torch
from field_rays import SPACE, rays, samples

from baselines.nerf_w import NerfWConfig, NerfWModel, nerf_w_losses
from baselines.volumetric.compositing import INFINITE
from baselines.volumetric.model import TrainingContext
from baselines.volumetric.rays.batches import Batch

CONFIG = NerfWConfig(balls.SMALL, transient_width=16, embedding_rate=3e-3)


def model():
    return NerfWModel(CONFIG, SPACE, torch.Generator().manual_seed(0), 3)


def losses_of(rendering, colours):
    n = len(colours)
    return nerf_w_losses(CONFIG)(rendering, Batch(rays(n), colours, torch.ones(n), torch.arange(n) % 3))


class Given(torch.nn.Module):
    """Stands for a field and a head whose densities are known."""

    features = 15

    def __init__(self, static, passing):
        super().__init__()
        self.static, self.passing = torch.nn.Parameter(static), torch.nn.Parameter(passing)

    def geometry(self, points):
        return self.static, torch.zeros(*points.shape[:2], 15)

    def colour(self, features, directions, embeddings=None):
        return torch.full((*features.shape[:2], 3), 0.25)

    def forward(self, features, embeddings):
        return self.passing, torch.full((*features.shape[:2], 3), 0.75), torch.full(features.shape[:2], 2.0)


def shaded(static, passing, lengths):
    """A rendering of rays with known densities, and the model."""
    given, nerf = Given(static, passing), model()
    nerf.field, nerf.head = given, given
    context = TrainingContext(torch.arange(len(static)) % 3, torch.zeros(2, len(static)))
    return nerf.shade(rays(len(static)), samples(lengths), context), given


def test_static_and_transient_matter_share_what_an_interval_emits():
    rendering, _ = shaded(torch.tensor([[1.0, 0.5]]), torch.tensor([[3.0, 0.5]]), torch.tensor([[0.2, INFINITE]]))
    first, rest = 1 - np.exp(-0.8), np.exp(-0.8)
    transient = 0.75 * first + 0.5 * rest
    np.testing.assert_allclose(rendering.colour.detach(), [[0.25 + 0.5 * transient] * 3], rtol=1e-5)
    np.testing.assert_allclose(rendering.extras["beta"].detach(), [0.03 + 2 * transient], rtol=1e-5)


def test_everything_stays_finite_on_empty_saturated_and_identical_rays():
    static, passing, lengths = torch.zeros(6, 4), torch.zeros(6, 4), torch.ones(6, 4)
    static[1], static[2, 0] = 1e9, 1e30
    passing[3], passing[2, 0], passing[4, 3] = 1e9, 1e30, 1e-30
    lengths[:, -1] = INFINITE
    rendering, given = shaded(static, passing, lengths)
    losses = losses_of(rendering, rendering.colour.detach().clone())  # photographs that are matched exactly
    assert {"colour", "uncertainty", "density"} <= set(losses)
    assert all(torch.isfinite(term) for term in losses.values())
    assert rendering.extras["beta"].min().item() == pytest.approx(0.03)  # that of an empty ray
    sum(losses.values()).backward()
    assert all(torch.isfinite(density.grad).all() for density in (given.static, given.passing))


def test_the_loss_is_its_four_terms():
    rendering, _ = shaded(torch.tensor([[1.0], [0.0]]), torch.tensor([[0.0], [2.0]]), torch.ones(2, 1))
    losses = losses_of(rendering, torch.full((2, 3), 0.4))
    weight = 1 - np.exp([-1.0, -2.0])
    beta = 0.03 + np.array([0, 2 * weight[1]])
    error = (np.array([0.25, 0.75]) * weight - 0.4) ** 2
    assert losses["colour"].item() == pytest.approx(np.mean(error / (2 * beta**2)), rel=1e-5)
    assert losses["uncertainty"].item() == pytest.approx(np.mean(np.log(beta)), rel=1e-5)
    assert losses["density"].item() == pytest.approx(0.01 * 1.0)


def test_scoring_renders_the_static_scene_in_its_mean_appearance():
    nerf = model()
    with torch.no_grad():
        nerf.appearance.copy_(torch.randn(3, 48))
        shown = nerf(rays(50)).colour
        nerf.transient.add_(5.0)
        nerf.head.exit.bias.add_(3.0)
        assert torch.equal(nerf(rays(50)).colour, shown)
        nerf.appearance.copy_(nerf.appearance.mean(0).expand(3, -1))
        torch.testing.assert_close(nerf(rays(50)).colour, shown)
        nerf.appearance.add_(1.0)
        assert not torch.allclose(nerf(rays(50)).colour, shown, atol=1e-4)
