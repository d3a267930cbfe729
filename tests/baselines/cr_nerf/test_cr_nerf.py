"""CR-NeRF: what it renders, the cases that break it, and that styles and masks do what they are for."""

from dataclasses import replace

import balls
import numpy as np
import pytest
import torch
from ball_methods import CR_NERF as CONFIG
from field_rays import (
    SPACE,
    KnownField,
    batch,
    context,
    noise,
    rays,
    samples,
    sees_its_view_or_the_mean,
    shaded,
    stays_finite,
)

from baselines.cr_nerf.losses import cr_nerf_losses
from baselines.cr_nerf.model import KEPT, CrNerfModel
from baselines.training.images import TrainingImages
from baselines.volumetric.compositing import INFINITE
from baselines.volumetric.rays.photographs import as_seen


def model(config=CONFIG, views=3):
    made = CrNerfModel(config, SPACE, torch.Generator().manual_seed(0), views)
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():  # so that neither matrices nor masks are as at the start
        for weight in (made.content.fc.weight, made.style.fc.weight, made.transients.exit.weight):
            weight.add_(torch.randn(weight.shape, generator=generator))
    made.prepare(noise(views))
    return made


def test_the_loss_is_its_terms():
    field = KnownField(torch.tensor([[0.5, 2.0], [0.1, 0.2], [3.0, 0.0]]), torch.full((3, 8), 0.25))
    of = replace(batch(3), weights=torch.tensor([1.0, 0.5, 0.0]))
    rendering = shaded(model(), field, torch.ones(3, 2), of)
    extras = rendering.extras | {"m": torch.tensor([0.2, 0.9, 0.6]), "price": torch.tensor(0.5)}
    losses = cr_nerf_losses(CONFIG)(replace(rendering, extras=extras), of)
    error = ((rendering.colour.detach().double().numpy() - 0.4) ** 2).mean(1)
    maps = extras["maps"].detach().double().numpy()
    assert losses["colour"].item() == pytest.approx(np.mean(np.array([0.8, 0.5 * 0.1, 0]) * error) / 2, rel=1e-5)
    assert losses["size"].item() == pytest.approx(0.5 * np.mean([0.04, 0.5 * 0.81, 0]), rel=1e-5)
    assert losses["style"].item() == pytest.approx(1e-5 * np.mean(maps**2), rel=1e-5)


def test_a_step_is_coloured_by_all_its_rays_and_each_rays_photograph():
    made, f = model(), torch.rand(40, 8, generator=torch.Generator().manual_seed(2))
    of = replace(batch(40), views=torch.arange(40) // 20 + 1)
    with torch.no_grad():
        found = shaded(made, KnownField(torch.ones(40, 2), f), torch.full((40, 2), INFINITE), of).colour
        f0 = f - f.mean(0)
        for view in (1, 2):
            style_map = made.encoder(as_seen(made._pictures[[view]]))[0]
            s, mine = style_map.mean(0), of.views == view
            by_style, by_content = made.style((style_map - s)[None]), made.content(f0[None])
            torch.testing.assert_close(found[mine], made.transform(f0[mine], by_style @ by_content, s[None]))
            turned_round = made.transform(f0[mine], by_content @ by_style, s[None])
            assert (turned_round - found[mine]).abs().max() > 1e-4


def test_everything_stays_finite_on_empty_saturated_and_identical_rays():
    stays_finite(model, 8, cr_nerf_losses(CONFIG), "transients")


@pytest.mark.parametrize("background", [None, (0.2, 0.6, 0.9)])
def test_where_a_ray_meets_nothing_the_background_is_seen(background):
    made = model(replace(CONFIG, volumetric=replace(balls.SMALL, background=background)))
    made.field = KnownField(torch.zeros(2, 3), torch.full((2, 8), 0.25))
    with torch.no_grad():
        colour = made.shade(rays(2), samples(torch.ones(2, 3)), None).colour
    torch.testing.assert_close(colour, torch.tensor(background or (0.0, 0.0, 0.0)).expand(2, -1))


def test_scoring_renders_the_scene_in_the_mean_style_of_the_views():
    made, part = model(), torch.tensor([[2.0], [-1.0], [-1.0]])  # whose mean is nought
    with torch.no_grad():
        shown = made(rays(50)).colour
        made.style_means.add_(part)
        made.style_matrices.add_(part[..., None])
        made.transients.exit.bias.add_(3.0)
        torch.testing.assert_close(made(rays(50)).colour, shown)
        for kept in (made.style_means, made.style_matrices):
            before = kept.clone()
            kept.add_(1.0)
            assert not torch.allclose(made(rays(50)).colour, shown, atol=1e-4)
            kept.copy_(before)
        made.style_means.zero_()
        made.finish()
        torch.testing.assert_close(made(rays(50)).colour, shown)


def test_the_mean_style_is_the_style_where_all_photographs_are_the_same():
    made = model()
    made.prepare(TrainingImages([np.random.default_rng(3).integers(0, 256, (24, 32, 3), np.uint8)] * 3))
    of = batch(50, view=1)
    with torch.no_grad():
        trained = made(of.rays, context(of))
        made.content_mean.copy_(trained.extras["content_mean"])
        made.content_matrix.copy_(trained.extras["content_matrix"])
        torch.testing.assert_close(made.shade(of.rays, trained.samples, None).colour, trained.colour)


def test_rays_see_their_views_style_or_the_mean_one():
    sees_its_view_or_the_mean(model(replace(CONFIG, style=replace(CONFIG.style, mean_share=0.5))))


def test_what_is_kept_is_that_of_the_last_visit_and_the_mean_of_steps():
    made, of = model(), batch(64, view=2)
    with torch.no_grad():
        made.encoder.exit.bias.add_(1.0)
        before = made.style_means.clone()
        first = made(of.rays, context(of))
        made.after_step(first, of)
        torch.testing.assert_close(made.style_means[:2], before[:2], rtol=0, atol=0)
        assert (made.style_means[2] - before[2]).abs().min() > 0.1
        mean = first.extras["content_mean"]
        torch.testing.assert_close(made.content_mean, mean)  # nothing of the start remains
        torch.testing.assert_close(made.content_matrix, first.extras["content_matrix"])
        for _ in range(199):
            made.after_step(replace(first, extras=first.extras | {"content_mean": mean + 1}), of)
    added = 0.0  # from the hundredth step on each counts a hundredth
    for step in range(1, 200):
        weight = max(1 - KEPT, 1 / (1 + step))
        added = (1 - weight) * added + weight
    torch.testing.assert_close(made.content_mean, mean + added)
