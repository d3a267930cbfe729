"""Ha-NeRF: its loss, the cases that break it, and that looks and masks do what they are for."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from ball_methods import HA_NERF as CONFIG
from by_hand import applied, convolved
from field_rays import SPACE, batch, context, noise, rays, sees_its_view_or_the_mean, stays_finite

from baselines.ha_nerf.config import LookConfig, VisibilityConfig
from baselines.ha_nerf.look import LookEncoder
from baselines.ha_nerf.losses import ha_nerf_losses
from baselines.ha_nerf.model import HaNerfModel
from baselines.ha_nerf.visibility import Visibility
from baselines.volumetric.model import Rendering, Samples


def model(config=CONFIG, views=3):
    made = HaNerfModel(config, SPACE, torch.Generator().manual_seed(0), views)
    made.prepare(noise(views))
    return made


def losses_of(colours, m, coarse, counts):
    """The losses of a rendering whose greys and masks are given."""
    n = len(colours)
    extras = {"m": m, "price": torch.tensor(0.5), "looks": torch.tensor([[1.0, 3.0]])}
    weights, edges = torch.zeros(n, 2), torch.linspace(0, 1, 3).expand(n, -1)
    where = Samples(edges, weights, torch.zeros(n, 2, 3))
    rendering = Rendering(colours[:, None].expand(-1, 3), weights, where, edges, weights, coarse, extras)
    return ha_nerf_losses(CONFIG)(rendering, replace(batch(n), weights=counts))


def test_the_loss_is_its_terms():
    m, counts = torch.tensor([0.2, 0.9, 0.6]), torch.tensor([1.0, 0.5, 0.0])
    losses = losses_of(torch.tensor([0.5, 0.1, 0.4]), m, torch.full((3, 3), 0.8), counts)
    error, weight = np.array([0.01, 0.09, 0.0]), np.array([1, 0.5, 0]) * (1 - np.array([0.2, 0.9, 0.6]))
    assert losses["colour"].item() == pytest.approx(np.mean(weight * error) / 2, rel=1e-5)
    assert losses["coarse"].item() == pytest.approx(np.mean(weight * 0.16) / 2, rel=1e-5)
    assert losses["size"].item() == pytest.approx(0.5 * np.mean([0.04, 0.5 * 0.81, 0]), rel=1e-5)
    assert losses["look"].item() == pytest.approx(1e-5 * 5)


def test_the_coarse_error_teaches_the_masks_nothing():
    m, coarse = torch.tensor([0.2, 0.9], requires_grad=True), torch.full((2, 3), 0.8, requires_grad=True)
    sum(losses_of(torch.full((2,), 0.4), m, coarse, torch.ones(2)).values()).backward()
    np.testing.assert_allclose(m.grad, 0.5 * 2 * m.detach() / 2, rtol=1e-5)  # that of the size alone: the error is 0
    assert (coarse.grad != 0).all()


def test_everything_stays_finite_on_empty_saturated_and_identical_rays():
    stays_finite(model, 3, ha_nerf_losses(CONFIG), "visibility")


def test_scoring_renders_the_scene_in_the_mean_look_of_the_views():
    made = model()
    with torch.no_grad():
        shown = made(rays(50)).colour
        made.looks.add_(torch.tensor([[2.0], [-1.0], [-1.0]]))  # the mean stays
        torch.testing.assert_close(made(rays(50)).colour, shown)
        made.visibility.exit.bias.add_(3.0)
        torch.testing.assert_close(made(rays(50)).colour, shown)
        made.looks.add_(1.0)
        assert not torch.allclose(made(rays(50)).colour, shown, atol=1e-4)
        made.finish()
        torch.testing.assert_close(made(rays(50)).colour, shown)


def test_rays_see_their_views_look_or_the_mean_one():
    sees_its_view_or_the_mean(model(replace(CONFIG, look=replace(CONFIG.look, mean_share=0.5))))


def test_the_looks_that_are_kept_are_those_of_the_last_visit():
    made, of = model(), batch(64, view=2)
    with torch.no_grad():
        made.encoder.exit.bias.add_(1.0)
        before = made.looks.clone()
        made.after_step(made(of.rays, context(of)), of)
        torch.testing.assert_close(made.looks[:2], before[:2], rtol=0, atol=0)
        torch.testing.assert_close(made.looks[2], before[2] + 1)


MASKS = VisibilityConfig(code=8, octaves=4, width=16, layers=2, price=3.5, relative=True)


@pytest.mark.parametrize("at_first", [0.05, 0.5])
def test_masks_start_the_same_everywhere(at_first):
    network = Visibility(replace(MASKS, at_first=at_first), 5, torch.Generator().manual_seed(0))
    m = network(torch.arange(40) % 5, torch.rand(40, 2, generator=torch.Generator().manual_seed(1)))
    np.testing.assert_allclose(m.detach(), at_first, rtol=1e-6)


def test_the_network_learns_the_mask_of_one_view_and_leaves_the_others():
    """In 200 steps of the ha-nerf loss with given errors: 1 in a corner of view 1, a hundredth elsewhere."""
    network = Visibility(MASKS, 3, torch.Generator().manual_seed(0))
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    side = (torch.arange(12) + 0.5) / 12
    places, views = torch.cartesian_prod(side, side).repeat(3, 1), torch.arange(3).repeat_interleave(144)
    corner = (places < 0.5).all(1) & (views == 1)
    errors = torch.where(corner, 1.0, 0.01)
    for _ in range(200):
        m = network(views, places)
        optimiser.zero_grad()
        ((0.5 * (1 - m) * errors).mean() + MASKS.price * 0.01 * m.square().mean()).backward()
        optimiser.step()
    m = network(views, places)
    assert m[corner].mean() > 0.9
    assert m[views != 1].mean() < 0.15


def test_the_look_is_that_of_its_formula():
    network = LookEncoder(LookConfig(size=5, channels=(3, 4, 6), side=16), torch.Generator().manual_seed(0))
    with torch.no_grad():
        for layer in (network.entry, *network.halving):
            layer.bias.uniform_(-0.2, 0.2, generator=torch.Generator().manual_seed(1))
    x = picture = np.random.default_rng(0).uniform(-1, 1, (3, 11, 9))
    for layer in (network.entry, *network.halving):
        x = np.maximum(convolved(layer, x), 0)
    found = network(torch.from_numpy(picture[None]).float())[0].detach()
    np.testing.assert_allclose(found, applied(network.exit, x.mean((1, 2))), rtol=1e-4, atol=1e-5)
