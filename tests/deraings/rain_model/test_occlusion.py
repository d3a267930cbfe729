"""The probability that a drop hides a pixel: from a network, from what stays, and from the residual."""

import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork

from baselines.splatting.kernels.photometric import prepare_target
from deraings.image_planes import resized
from deraings.rain_model.config import OcclusionConfig
from deraings.rain_model.occlusion import MOST, Occlusion, residual_likelihood
from hydroviews.scene.images import to_uint8

COUNT, SIZE, DROP = 24, (60, 80), 4
CONFIG = OcclusionConfig()
STAYS = (slice(12, 30), slice(20, 50))


def staying(cover=0.8):
    """Covers [h, w] of drops that stay, predicted alike in every view."""
    planes = np.zeros((COUNT, *SIZE), np.float32)
    planes[(slice(None), *STAYS)] = cover
    return planes


def renewed(seed=0, drops=30):
    """Covers of small drops that are new in every view."""
    rng, planes = np.random.default_rng(seed), np.zeros((COUNT, *SIZE), np.float32)
    for plane in planes:
        for row, column in rng.integers(0, SIZE, (drops, 2)):  # edges have as many: they go on at the other side
            rows, columns = (
                np.arange(start, start + DROP) % side for start, side in zip((row, column), SIZE, strict=True)
            )
            plane[np.ix_(rows, columns)] = 0.8
    return planes


def occlusion_of(covers, config=CONFIG):
    return Occlusion(PretendedNetwork(covers=list(covers)), len(covers), config)


def test_all_of_the_cover_of_drops_that_stay_recurs():
    assert occlusion_of(staying()).recurring == pytest.approx(1, abs=1e-5)
    unsure = staying() * np.random.default_rng(0).uniform(0.5, 1, (COUNT, 1, 1)).astype(np.float32)
    assert occlusion_of(unsure).recurring > 0.9


def test_none_of_the_cover_of_drops_that_are_new_in_every_view_recurs():
    assert np.mean([occlusion_of(renewed(seed)).recurring for seed in range(5)]) < 0.1
    assert occlusion_of(np.zeros((COUNT, *SIZE), np.float32)).recurring == 0


def test_a_lens_is_wet_where_drops_stay():
    assert occlusion_of(staying()).wet
    assert not occlusion_of(renewed()).wet
    assert not occlusion_of(np.zeros((COUNT, *SIZE), np.float32)).wet


def test_the_cover_that_recurs_is_left_to_the_lines():
    occlusion = occlusion_of(staying())
    assert occlusion.recurring_cover(3) == pytest.approx(occlusion.recurring * staying()[0], abs=1e-6)
    assert occlusion_of(np.zeros((COUNT, *SIZE), np.float32)).recurring_cover(0).max() == 0


def test_the_prior_of_drops_that_stay_falls_with_the_views_that_lines_are_fitted_to():
    occlusion = occlusion_of(staying())
    inside = [occlusion.prior(0, SIZE, n)[STAYS].mean() for n in (0, 8, CONFIG.pseudo_views, 1000)]
    assert inside[0] == pytest.approx(0.8, abs=1e-4)
    assert inside[2] == pytest.approx(0.4, abs=1e-4)
    assert inside == sorted(inside, reverse=True)
    assert inside[3] < 0.03
    assert occlusion.prior(0, SIZE, 0)[40:].max() < 1e-4


def test_the_prior_of_renewed_drops_is_where_this_view_has_them_however_many_lines_there_are():
    covers = renewed()
    occlusion = occlusion_of(covers)
    occlusion.recurring = 0.0
    prior = occlusion.prior(5, SIZE, 1e9)
    assert prior == pytest.approx(covers[5], abs=1e-5)
    assert (occlusion.prior(5, SIZE, 0) >= prior - 1e-6).all()  # where others have them as well


@pytest.mark.parametrize("size", [SIZE, (23, 31)])
def test_the_prior_is_the_formula_of_the_page(size):
    rng = np.random.default_rng(3)
    covers = rng.random((COUNT, *SIZE)).astype(np.float32)
    occlusion = occlusion_of(covers)
    occlusion.recurring = 0.3
    q = resized(covers[2], size).astype(np.float64)
    p = resized(np.delete(covers, 2, axis=0).mean(axis=0), size) * CONFIG.pseudo_views / (CONFIG.pseudo_views + 10)
    assert occlusion.prior(2, size, 10) == pytest.approx(0.3 * p + 0.7 * (1 - (1 - p) * (1 - q)), abs=1e-5)


@pytest.fixture(scope="module")
def view():
    return panorama.views_of(panorama.paint(), 1)[0]


def target_of(image, ignored=None):
    return prepare_target(to_uint8(image), ignored)


def noisy(image, seed=2):
    return np.clip(image + 0.03 * np.random.default_rng(seed).standard_normal(image.shape), 0, 1).astype(np.float32)


def test_the_likelihood_of_a_residual_is_that_of_laplace_distributions(view):
    """Around 3 x 3 pixels, with b from the median, in float64."""
    seen = noisy(view)
    residual = np.abs(to_uint8(view) / 255 - seen).mean(axis=2).astype(np.float64)
    padded = np.pad(residual, 1, "reflect")
    height, width = residual.shape
    around = sum(padded[r : r + height, c : c + width] for r in range(3) for c in range(3)) / 9
    b = np.median(around[::2, ::2]) / np.log(2)
    expected = np.minimum(np.exp(around / (2 * b)) / 2, CONFIG.trust)
    assert residual_likelihood(target_of(view), seen, CONFIG.trust) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("trust", [1.0, 2.0, 5.0])
def test_the_likelihood_stays_within_a_half_and_trust(view, trust):
    seen = noisy(view)
    seen[10:22, 10:22], seen[30:40, 30:40] = 1, to_uint8(view)[30:40, 30:40] / np.float32(255)
    likely = residual_likelihood(target_of(view), seen, trust)
    assert likely.min() == pytest.approx(0.5, abs=1e-4)
    assert likely.max() == pytest.approx(trust, rel=1e-4)
    assert likely[14:18, 14:18].min() > 0.99 * trust


def test_what_a_mask_hides_says_nothing(view):
    """Hidden pixels are black: against the render they would be the largest residuals."""
    ignored = np.zeros(view.shape[:2], bool)
    ignored[:, :30] = True
    seen = noisy(view)
    likely = residual_likelihood(target_of(view, ignored), seen, CONFIG.trust)
    other = np.where(ignored[..., None], np.float32(1), seen)
    changed = residual_likelihood(target_of(view, ignored), other, CONFIG.trust)
    assert changed[~ignored] == pytest.approx(likely[~ignored], rel=1e-4)
    whole = residual_likelihood(target_of(view), seen, CONFIG.trust)
    assert np.abs(likely - whole)[:, 32:].max() < 0.3
    nothing = residual_likelihood(target_of(view, np.ones_like(ignored)), seen, CONFIG.trust)
    assert np.isfinite(nothing).all()


def test_what_is_shown_is_the_posterior_of_prior_and_residual(view):
    seen, prior = noisy(view), np.random.default_rng(0).random(view.shape[:2]).astype(np.float32)
    occlusion, target = occlusion_of(staying()), target_of(view)
    likely = residual_likelihood(target, seen, CONFIG.trust).astype(np.float64)
    pi = np.minimum(prior, MOST).astype(np.float64)
    r = CONFIG.cost * pi * likely / (CONFIG.cost * pi * likely + 1 - pi)
    assert occlusion.shown(prior, target, lambda: seen) == pytest.approx(1 - r, abs=1e-4)


def test_a_drop_is_hidden_more_than_a_part_of_the_scene_that_a_network_takes_for_one(view):
    drop, mistake = (slice(8, 20), slice(10, 22)), (slice(28, 40), slice(40, 52))
    wet, prior = view.copy(), np.zeros(view.shape[:2], np.float32)
    wet[drop] = panorama.shaded_drop(12, 12)
    prior[drop] = prior[mistake] = 0.4
    shown = occlusion_of(staying()).shown(prior, target_of(wet), lambda: noisy(view))
    assert shown[drop][2:-2, 2:-2].mean() < shown[mistake].mean() - 0.1
    assert shown[prior == 0].min() == 1
