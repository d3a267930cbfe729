"""The prior of mist: from scene points, from sources of known means and errors, and with a source missing."""

from dataclasses import replace

import numpy as np
import panorama
import pytest
from pale_points import AIR, TYPICAL_DEPTH, VIEWS, alpha_at, pale_points

from baselines.training.images import TrainingImages
from deraings.lens import mist_prior as prior_module
from deraings.lens.mist_bounds import MistBounds, mist_bounds, mist_light
from deraings.lens.mist_prior import NetworkMist, mist_exists, mist_prior, weighed_mean
from deraings.lens.paleness import MIN_VIEWS, MistEvidence, fit_paleness, mist_evidence, paleness_of

ROWS = np.stack(np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 5)), axis=2)
CELL_ROWS = np.broadcast_to(((np.arange(16) + 0.5) / 16)[:, None, None], (16, 16, 2))


def bounds_of(even=0.05, times=2):
    """What may be: `alpha_at`, and so much more that is even."""
    possible = np.repeat(alpha_at(ROWS)[None], times, axis=0)
    return MistBounds(VIEWS, AIR, possible + np.float32(even), possible, [None] * VIEWS)


def no_network(_): ...


def prior_of(bounds, network, points=None):
    return mist_prior(MistEvidence(bounds, None if points is None else paleness_of(bounds, points)), network)


def sees(alpha, error=0.0):
    """A network that predicts so much of `alpha_at`, with an error of mist_alpha."""
    light = (alpha * alpha_at(CELL_ROWS) * AIR.mean()).astype(np.float32)
    return lambda _: NetworkMist(light, np.full((16, 16), error * AIR.mean(), np.float32))


def test_the_mean_of_sources_is_weighed_by_the_inverse_variances():
    means, deviations = np.float32([[0.1, 0.3], [0.2, 0.0]]), np.float32([[0.1, 0.2], [0.3, 0.2]])
    mean, deviation = weighed_mean(list(zip(means, deviations, strict=True)))
    precision = 1 / deviations**2
    assert mean == pytest.approx((precision * means).sum(axis=0) / precision.sum(axis=0))
    assert deviation == pytest.approx(precision.sum(axis=0) ** -0.5)


def test_with_nothing_but_the_bound_any_mist_up_to_it_is_as_likely():
    bounds = bounds_of()
    for points in (None, pale_points(points=10)):  # too few say nothing
        prior = prior_of(bounds, no_network, points)
        assert prior.mean == pytest.approx(bounds.possible / 2)
        assert prior.deviation == pytest.approx(np.maximum(bounds.possible / np.sqrt(12), prior_module.LEAST), rel=1e-4)
        assert prior.evidence.paleness is None


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.6])
def test_a_network_that_is_sure_is_followed(alpha):
    prior, alone = prior_of(bounds_of(), sees(alpha)), prior_of(bounds_of(), no_network)
    middle = np.s_[:, 1:-1]  # cells end half of one before the edges of the lens
    assert prior.mean[middle] == pytest.approx(alpha * bounds_of().possible[middle], abs=0.03)
    assert (prior.deviation <= alone.deviation).all()


def test_the_error_of_a_network_is_that_over_photographs_and_what_photographs_share():
    possible = bounds_of().possible[:, 2]
    mean = 0.5 * possible
    own = np.sqrt(0.02**2 + (prior_module.NETWORK_SHARE * mean) ** 2 + prior_module.NETWORK_LEAST**2)
    expected = weighed_mean([(mean, possible / np.sqrt(12)), (mean, own)])[1]
    assert prior_of(bounds_of(), sees(0.5, 0.02)).deviation[:, 2] == pytest.approx(expected, rel=0.02)


def test_what_a_network_predicts_at_one_time_is_expected_then_and_nothing_for_a_time_does_not_count():
    half, blind = VIEWS // 2, prior_of(bounds_of(), no_network).mean
    late = prior_of(bounds_of(), lambda view: sees(0.0)(view) if view >= half else None).mean
    some = prior_of(bounds_of(), lambda view: sees(0.0)(view) if view % 5 == 0 else None).mean
    drying = prior_of(bounds_of(), lambda view: sees(1.0 if view < half else 0.0)(view)).mean
    assert np.array_equal(late, blind)
    assert np.array_equal(some, prior_of(bounds_of(), sees(0.0)).mean)
    first, last = drying.mean(axis=(1, 2))
    assert first > 3 * last


@pytest.mark.parametrize("network", [no_network, sees(0.0, 0.3)])
def test_points_that_show_mist_raise_what_is_expected(network):
    means = [prior_of(bounds_of(), network, pale_points(share)).mean.mean() for share in (0.0, 0.5, 1.0)]
    assert means == sorted(means)
    assert means[2] - means[0] > 0.03


def test_points_alone_pull_from_the_middle_toward_what_they_show():
    bounds = bounds_of()
    prior = prior_of(bounds, no_network, pale_points(1.0))
    assert prior.evidence.paleness.mist == pytest.approx(1.25, abs=0.15)
    share = prior.mean[:, :-1] / bounds.possible[:, :-1]
    assert ((share > 0.55) & (share < prior.evidence.paleness.mist)).all()
    assert (prior.deviation <= prior_of(bounds, no_network).deviation).all()


def test_fog_widens_and_never_lowers_below_no_mist():
    """In fog points grow pale at all depths: what they show of mist counts for less."""
    clear, foggy = (prior_of(bounds_of(), no_network, pale_points(0.0, fog)) for fog in (0.0, 1.0))
    assert (foggy.deviation > 1.05 * clear.deviation)[bounds_of().possible > 0].all()
    for prior in (clear, foggy):
        assert (prior.mean >= 0).all()
        assert prior.evidence.paleness is not None


def test_no_more_is_expected_than_the_photographs_allow():
    bounds = bounds_of(even=0.0)
    prior = prior_of(replace(bounds, max_alpha=bounds.possible / 4), sees(3.0))
    assert prior.mean == pytest.approx(bounds.possible / 4)


@pytest.mark.parametrize(
    ("network", "share", "fog", "wet", "exists"),
    [
        (sees(0.3), 0.0, 0.0, False, True),
        (sees(0.0), 1.0, 0.0, False, False),  # a network is asked before points
        (sees(0.0), 0.0, 0.0, True, True),
        (no_network, 1.0, 0.0, False, True),
        (no_network, 0.0, 0.0, False, False),
        (sees(0.3), 0.0, 1.0, True, False),  # fog is in the scene
    ],
)
def test_a_network_a_wet_lens_or_points_show_that_there_is_mist(network, share, fog, wet, exists):
    prior = prior_of(bounds_of(), network, pale_points(share, fog))
    assert mist_exists(prior, wet) == exists


SIZE = panorama.HEIGHT, panorama.WIDTH
PIXEL_ROWS = np.broadcast_to(np.linspace(0, 1, SIZE[0])[:, None, None], (*SIZE, 2))


def fitted(points):
    return fit_paleness(points, alpha_at(points.places), AIR)


def misted_pictures(count=24):
    scene = panorama.views_of(panorama.paint(), count)
    return panorama.eight_bit(panorama.misted(scene, alpha_at(PIXEL_ROWS), AIR))


@pytest.mark.parametrize("drops", [0.0, 0.15])
@pytest.mark.parametrize("upright", [0.0, 0.9])
@pytest.mark.parametrize("fog", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("mist", [0.0, 0.5, 1.0])
def test_mist_is_told_from_fog(mist, fog, upright, drops):
    found = fitted(pale_points(mist, fog, upright, drops))
    # Deviations are taken for shares of what mist has left: it is 0.2 in the mean.
    assert found.mist == pytest.approx(mist / (1 - 0.2 * mist), abs=0.1 + 0.2 * fog)
    assert found.fog == pytest.approx(fog * np.log(2) * TYPICAL_DEPTH, rel=0.25, abs=0.03)


def test_the_standard_error_falls_with_the_root_of_the_number_of_points_and_grows_with_noise():
    given = ((100, 0.02), (1600, 0.02), (100, 0.06))
    few, many, noisy = (fitted(pale_points(points=n, noise=noise)).mist_error for n, noise in given)
    assert few / many == pytest.approx(4, rel=0.3)
    assert 2 < noisy / few < 4


def test_the_standard_error_covers_the_scatter_of_what_is_found():
    found = [fitted(pale_points(0.5, points=150, noise=0.03, seed=seed)) for seed in range(12)]
    scatter = np.std([each.mist for each in found])
    assert 0 < scatter < np.mean([each.mist_error for each in found]) < 0.3


def test_too_little_is_no_evidence():
    assert fitted(pale_points(views=MIN_VIEWS - 1)) is None
    points = pale_points()
    assert fit_paleness(points, np.full_like(points.depths, 0.3), AIR) is None
    points.seen[30:] = False
    assert fitted(points) is None


@pytest.mark.parametrize("mist", [0.0, 0.5])
def test_photographs_say_where_mist_may_be_and_points_how_much_of_it_is_there(mist):
    bounds = mist_bounds(misted_pictures())
    found = paleness_of(bounds, pale_points(mist, air=bounds.colour))
    assert found.mist == pytest.approx(mist / (1 - 0.2 * mist), abs=0.15)


def test_points_under_drops_do_not_count():
    """A drop of one colour lies over the lower quarter of the lens, where points show its colour."""
    pictures = misted_pictures()
    for picture in pictures:
        picture[33:] = 128
    bounds = mist_bounds(pictures)
    points = pale_points(0.5, air=bounds.colour)
    points.colours[points.places[..., 1] > 0.8] = 128 / 255
    wet, dry = (paleness_of(given, points) for given in (replace(bounds, masks=[None] * len(pictures)), bounds))
    alone = replace(points, seen=points.seen & (points.places[..., 1] < 0.7))
    expected = paleness_of(bounds, alone).mist
    assert dry.mist == pytest.approx(expected, abs=0.1)
    assert abs(wet.mist - expected) > 0.2


@pytest.mark.parametrize(("fog", "foggy"), [(0.0, False), (0.5, True)])
def test_fog_in_the_scene_is_found(fog, foggy):
    images = TrainingImages(misted_pictures())
    air = mist_light([images.pixels(view) for view in range(len(images))])
    assert mist_evidence(images, pale_points(0.5, fog, air=air)).foggy == foggy
    assert not mist_evidence(images).foggy
