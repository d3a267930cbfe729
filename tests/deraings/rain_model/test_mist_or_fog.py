"""Points of known colours behind mist on the lens, in fog, and behind both."""

from types import SimpleNamespace

import numpy as np
import panorama
import pytest

from deraings.rain_model.mist import Mist, MistConfig
from deraings.rain_model.mist_or_fog import MIN_VIEWS, Paleness, fit_paleness, is_mist
from hydroviews.scene.images import to_srgb
from hydroviews.scene.point_colours import PointColours

POINTS, VIEWS = 400, 24
AIR = np.array([0.7, 0.75, 0.8], np.float32)


def alpha_at(places):
    """Thick above, none below: [P, V] of places [P, V, 2]."""
    return 0.4 * (1 - places[..., 1])


def looked_up(mist=1.0, fog=0.0, upright=0.0, drops=0.0, views=VIEWS, air=AIR):
    """Points seen through so much of `alpha_at`, in fog that takes a part of the light over the mean depth.

    Args:
        upright: how surely what is far is seen high in the photograph.
        drops: share of the colours that show something else.
    """
    rng = np.random.default_rng(0)
    places = rng.random((POINTS, views, 2))
    depths = 1 + 1.5 * (upright * (1 - places[..., 1]) + (1 - upright) * rng.random((POINTS, views)))
    own, light = 0.5 * rng.random((POINTS, 1, 3)), fog * np.log(2)
    passing = np.exp(-light * depths)[..., None]
    alpha = mist * alpha_at(places)[..., None]
    colours = (1 - alpha) * (passing * own + (1 - passing) * air) + alpha * air
    other = rng.random((POINTS, views)) < drops
    colours[other] = rng.random((other.sum(), 3))
    colours = np.clip(to_srgb(colours.astype(np.float32)) + 0.01 * rng.normal(size=colours.shape), 0, 1)
    seen = rng.random((POINTS, views)) < 0.5
    return PointColours(
        rng.normal(size=(POINTS, 3)),
        np.arange(views),
        rng.normal(size=(views, 3)),
        colours.astype(np.float32),
        places.astype(np.float32),
        depths.astype(np.float32),
        seen,
    )


def fitted(points):
    return fit_paleness(points, alpha_at(points.places), AIR)


@pytest.mark.parametrize("drops", [0.0, 0.15])
@pytest.mark.parametrize("upright", [0.0, 0.9])
@pytest.mark.parametrize("fog", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("mist", [0.0, 0.5, 1.0])
def test_mist_is_told_from_fog(mist, fog, upright, drops):
    found = fitted(looked_up(mist, fog, upright, drops))
    # Deviations are taken for shares of what mist has left: it is 0.2 in the mean.
    assert found.mist == pytest.approx(mist / (1 - 0.2 * mist), abs=0.1 + 0.2 * fog)
    typical = 1.75  # in the units of `looked_up`
    assert found.fog == pytest.approx(fog * np.log(2) * typical, rel=0.25, abs=0.02)


def test_without_depths_fog_is_mist():
    blind = looked_up(mist=0.0, fog=1.0, upright=0.9)
    blind.depths[:] = np.random.default_rng(1).permuted(blind.depths, axis=1)
    assert fitted(blind).mist > 0.5


def test_too_little_is_no_evidence():
    assert fitted(looked_up(views=MIN_VIEWS - 1)) is None
    points = looked_up()
    assert fit_paleness(points, np.full_like(points.depths, 0.3), AIR) is None
    points.seen[30:] = False
    assert fitted(points) is None


@pytest.mark.parametrize(
    ("mist", "fog", "wanted"),
    [(0.0, 0.0, False), (0.3, 0.0, False), (0.6, 0.0, True), (1.0, 0.0, True), (0.0, 1.0, False), (1.0, 0.5, False)],
)
def test_mist_is_looked_for_where_points_show_it_and_not_in_fog(mist, fog, wanted):
    scene = panorama.views_of(panorama.paint(), VIEWS)
    rows = np.linspace(0, 1, panorama.HEIGHT)[:, None]
    thick_above = alpha_at(np.broadcast_to(rows[..., None], (panorama.HEIGHT, panorama.WIDTH, 2)))
    pictures = panorama.eight_bit(panorama.misted(scene, thick_above, AIR))
    air = Mist(pictures, 100, MistConfig()).expected
    mist_on_lens = Mist(pictures, 100, MistConfig(), points=lambda: looked_up(mist, fog, air=air))
    assert mist_on_lens.wanted == wanted
    assert mist_on_lens.alpha(0, scene[0].shape[:2]).any() == wanted


@pytest.mark.parametrize(
    ("points", "seen", "wanted"),
    [
        (None, None, True),
        (None, 0.001, False),
        (None, 0.01, True),
        (Paleness(0.9, 0.0), 0.001, True),
        (Paleness(0.1, 0.0), 0.001, False),
        (Paleness(-0.2, 0.0), 0.01, True),
        (Paleness(-0.2, 0.0), None, False),
        (Paleness(0.6, 0.0), None, True),
        (Paleness(0.9, 0.3), 0.01, False),
    ],
)
def test_mist_is_believed_where_a_network_sees_it_or_points_show_it_but_not_in_fog(points, seen, wanted):
    assert is_mist(points, seen, MistConfig()) == wanted


def test_points_are_not_asked_where_photographs_have_no_mist():
    scene = panorama.views_of(panorama.paint(), 8)

    def asked():
        raise AssertionError

    assert not Mist(panorama.eight_bit(scene), 100, MistConfig(), points=asked).wanted


@pytest.mark.parametrize(("light", "wanted"), [(0.001, False), (0.02, True)])
def test_where_every_place_shows_something_dark_a_network_is_believed_alone(light, wanted):
    pictures = panorama.eight_bit(panorama.views_of(panorama.paint(), VIEWS))
    prior = SimpleNamespace(mist_light=lambda: light)
    assert not Mist(pictures, 100, MistConfig()).wanted
    assert Mist(pictures, 100, MistConfig(), prior=prior).wanted == wanted
