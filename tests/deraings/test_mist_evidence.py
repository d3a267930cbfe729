"""Points of known colours behind mist on the lens, in fog, and behind both."""

import numpy as np
import panorama
import pytest

from baselines.splatting.point_colours import PointColours
from deraings.mist_evidence import FEWEST_VIEWS, mist_there
from deraings.rain_lens import Veil, VeilConfig
from hydroviews.images import to_srgb

POINTS, VIEWS = 400, 24
AIR = np.array([0.7, 0.75, 0.8], np.float32)


def veil_at(places):
    """Thick above, none below: [P, V] of places [P, V, 2]."""
    return 0.4 * (1 - places[..., 1])


def looked_up(mist=1.0, fog=0.0, upright=0.0, drops=0.0, noise=0.01, views=VIEWS, seed=0):
    """Points seen through so much of `veil_at`, in fog that takes a share of light over the mean depth.

    Args:
        upright: how surely what is far is seen high in the photograph.
        drops: share of the colours that show something else.
    """
    rng = np.random.default_rng(seed)
    places = rng.random((POINTS, views, 2))
    depths = 1 + 1.5 * (upright * (1 - places[..., 1]) + (1 - upright) * rng.random((POINTS, views)))
    own, light = 0.5 * rng.random((POINTS, 1, 3)), fog * np.log(2)
    passing = np.exp(-light * depths)[..., None]
    share = mist * veil_at(places)[..., None]
    colours = (1 - share) * (passing * own + (1 - passing) * AIR) + share * AIR
    other = rng.random((POINTS, views)) < drops
    colours[other] = rng.random((other.sum(), 3))
    colours = np.clip(to_srgb(colours.astype(np.float32)) + noise * rng.normal(size=colours.shape), 0, 1)
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


def there(points):
    return mist_there(points, veil_at(points.places), AIR)


@pytest.mark.parametrize("drops", [0.0, 0.15])
@pytest.mark.parametrize("upright", [0.0, 0.9])
def test_mist_is_told_from_fog(upright, drops):
    rest = {"upright": upright, "drops": drops}
    assert there(looked_up(mist=0.0, **rest)) == pytest.approx(0, abs=0.05)
    assert there(looked_up(mist=1.0, **rest)) == pytest.approx(1 / 0.8, abs=0.1)  # of colours that mist has paled
    assert there(looked_up(mist=0.5, **rest)) == pytest.approx(0.5 / 0.9, abs=0.1)
    assert there(looked_up(mist=0.0, fog=1.0, **rest)) == pytest.approx(0, abs=0.15)
    assert there(looked_up(mist=1.0, fog=0.5, **rest)) == pytest.approx(1 / 0.8, abs=0.3)


def test_depths_are_what_tells_them():
    blind = looked_up(mist=0.0, fog=1.0, upright=0.9)
    blind.depths[:] = np.random.default_rng(1).permuted(blind.depths, axis=1)
    assert there(blind) > 0.5


def test_too_little_is_no_evidence():
    assert there(looked_up(views=FEWEST_VIEWS - 1)) is None
    points = looked_up()
    assert mist_there(points, np.full_like(points.depths, 0.3), AIR) is None
    points.seen[30:] = False
    assert there(points) is None


def test_mist_is_looked_for_where_the_points_show_it():
    scene = panorama.views_of(panorama.paint(), VIEWS)
    pictures = panorama.eight_bit(panorama.misted(scene, panorama.slanted_veil(0.4), AIR))
    veils = {
        mist: Veil(pictures, 100, VeilConfig(), points=lambda mist=mist: looked_up(mist=mist)) for mist in (0.0, 1.0)
    }
    assert Veil(pictures, 100, VeilConfig()).wanted
    assert not veils[0.0].wanted
    assert veils[0.0].evidence < 0.1
    assert not veils[0.0].share(0, scene[0].shape[:2]).any()


def test_points_are_not_asked_where_photographs_have_no_mist():
    scene = panorama.views_of(panorama.paint(), 8)

    def asked():
        raise AssertionError

    assert not Veil(panorama.eight_bit(scene), 100, VeilConfig(), points=asked).wanted
