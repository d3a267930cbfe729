from dataclasses import replace

import numpy as np
import panorama
import pytest
from pale_points import AIR, TYPICAL_DEPTH, alpha_at, pale_points

from baselines.training.images import TrainingImages
from deraings.lens.mist_bounds import mist_bounds, mist_light
from deraings.lens.paleness import MIN_VIEWS, fit_paleness, mist_evidence, paleness_of

SIZE = panorama.HEIGHT, panorama.WIDTH
ROWS = np.broadcast_to(np.linspace(0, 1, SIZE[0])[:, None, None], (*SIZE, 2))


def fitted(points):
    return fit_paleness(points, alpha_at(points.places), AIR)


def misted_pictures(count=24):
    scene = panorama.views_of(panorama.paint(), count)
    return panorama.eight_bit(panorama.misted(scene, alpha_at(ROWS), AIR))


@pytest.mark.parametrize("drops", [0.0, 0.15])
@pytest.mark.parametrize("upright", [0.0, 0.9])
@pytest.mark.parametrize("fog", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("mist", [0.0, 0.5, 1.0])
def test_mist_is_told_from_fog(mist, fog, upright, drops):
    found = fitted(pale_points(mist, fog, upright, drops))
    # Deviations are taken for shares of what mist has left: it is 0.2 in the mean.
    assert found.mist == pytest.approx(mist / (1 - 0.2 * mist), abs=0.1 + 0.2 * fog)
    assert found.fog == pytest.approx(fog * np.log(2) * TYPICAL_DEPTH, rel=0.25, abs=0.03)


def test_without_depths_fog_is_mist():
    blind = pale_points(mist=0.0, fog=1.0, upright=0.9)
    blind.depths[:] = np.random.default_rng(1).permuted(blind.depths, axis=1)
    assert fitted(blind).mist > 0.5


def test_the_standard_error_falls_with_the_root_of_the_number_of_points_and_grows_with_noise():
    few, many, noisy = (
        fitted(pale_points(points=points, noise=noise)).mist_error
        for points, noise in ((100, 0.02), (1600, 0.02), (100, 0.06))
    )
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
