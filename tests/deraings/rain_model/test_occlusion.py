"""The probability that a drop hides a pixel: from a network, and from what stays."""

import numpy as np
import pytest
from pretended_network import PretendedNetwork

from deraings.image_planes import resized
from deraings.rain_model.config import OcclusionConfig
from deraings.rain_model.occlusion import LEAST_WET, MOST, Occlusion

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


def test_all_of_the_cover_of_drops_that_stay_recurs_and_is_left_to_the_lines():
    occlusion = occlusion_of(staying())
    assert occlusion.wet
    assert occlusion.recurring == pytest.approx(1, abs=1e-5)
    assert occlusion.recurring_cover(3) == pytest.approx(occlusion.recurring * staying()[0], abs=1e-6)
    unsure = staying() * np.random.default_rng(0).uniform(0.5, 1, (COUNT, 1, 1)).astype(np.float32)
    assert occlusion_of(unsure).recurring > 0.9


def test_none_of_the_cover_of_drops_that_are_new_in_every_view_recurs():
    assert np.mean([occlusion_of(renewed(seed)).recurring for seed in range(5)]) < 0.1
    assert not occlusion_of(renewed()).wet
    nothing = occlusion_of(np.zeros((COUNT, *SIZE), np.float32))
    assert nothing.recurring == nothing.recurring_cover(0).max() == 0
    assert not nothing.wet


@pytest.mark.parametrize("size", [SIZE, (23, 31)])
@pytest.mark.parametrize("recurring", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("views", [0, 10, 1e9])
def test_the_prior_is_the_formula_of_the_page(size, recurring, views):
    covers = np.random.default_rng(3).random((COUNT, *SIZE)).astype(np.float32)
    occlusion = occlusion_of(covers)
    occlusion.recurring = recurring
    q = resized(covers[2], size).astype(np.float64)
    p = resized(np.delete(covers, 2, axis=0).mean(axis=0), size) * CONFIG.pseudo_views / (CONFIG.pseudo_views + views)
    expected = recurring * p + (1 - recurring) * (1 - (1 - p) * (1 - q))
    assert occlusion.prior(2, size, views) == pytest.approx(expected, abs=1e-5)


def test_what_is_shown_falls_with_the_probability_of_a_drop_and_is_never_nothing():
    occlusion = occlusion_of(staying(0.4))
    pi = occlusion.prior(0, SIZE, 0).astype(np.float64)
    assert occlusion.shown(0, SIZE, 0) == pytest.approx((1 - pi) / (CONFIG.cost * pi + 1 - pi), abs=1e-5)
    covered = occlusion_of(staying(1.0)).shown(0, SIZE, 0)[STAYS]
    assert covered == pytest.approx((1 - MOST) / (CONFIG.cost * MOST + 1 - MOST), rel=1e-3)
    assert occlusion_of(staying(LEAST_WET / 2)).shown(0, SIZE, 0) is None  # a view without drops is shown in full
    assert occlusion_of(staying(2 * LEAST_WET)).shown(0, SIZE, 0) is not None
