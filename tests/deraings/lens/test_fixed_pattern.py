import numpy as np
import panorama
import pytest

from deraings.lens.fixed_pattern import fixed_pattern
from deraings.lens.time_knots import time_weights
from hydroviews.scene.images import to_uint8

SIZE = (panorama.HEIGHT, panorama.WIDTH)
PLACE = (slice(18, 30), slice(25, 37))


def pictures_of(views):
    return [to_uint8(view) for view in views]


def measured(pictures, knots=1, hidden=None):
    return fixed_pattern(pictures, hidden or [None] * len(pictures), SIZE, knots)


@pytest.mark.parametrize("count", [8, 30, 120])
def test_a_clear_lens_shows_what_chance_leaves(count):
    shown = measured(pictures_of(panorama.views_of(panorama.paint(), count)))
    assert 1 < np.median(shown) < 1.6  # of the largest around each place
    assert np.quantile(shown, 0.95) < 2.2


def test_what_stays_on_the_lens_shows_the_more_the_more_views_there_are():
    excesses = []
    for count in (8, 30, 120):
        views = panorama.views_of(panorama.paint(), count)
        views[(slice(None), *PLACE)] = np.random.default_rng(2).uniform(0.2, 0.8, (12, 12, 3))
        shown = measured(pictures_of(views))[0]
        excesses.append(shown[PLACE].min() / np.median(shown))
    assert excesses[0] > 1.5
    assert excesses == sorted(excesses)


def test_what_came_late_stays_from_then_on():
    views = panorama.views_of(panorama.paint(), 36)
    views[(slice(18, None), *PLACE)] = np.random.default_rng(2).uniform(0.2, 0.8, (12, 12, 3))
    early, _, late = measured(pictures_of(views), knots=3)
    assert np.median(early[PLACE]) < 1.6
    assert late[PLACE].min() > 2


def test_cameras_that_do_not_move_show_no_place_that_stays():
    still = pictures_of(np.repeat(panorama.views_of(panorama.paint(), 1), 12, axis=0))
    assert np.median(measured(still)) < 1.3


def test_nothing_is_said_of_what_is_always_hidden_nor_of_grey_pictures():
    views = panorama.views_of(panorama.paint(), 12)
    views[(slice(None), *PLACE)] = 0.5
    hidden = np.zeros(SIZE, bool)
    hidden[PLACE] = True
    shown = measured(pictures_of(views), hidden=[hidden] * 12)[0]
    assert not shown[20:28, 27:35].any()
    grey = measured([np.full((*SIZE, 3), 128, np.uint8)] * 12)
    assert np.isfinite(grey).all()
    assert grey.max() < 1.2


def test_a_place_that_few_views_show_says_no_more_than_its_share():
    """Few gradients leave more of their mean by chance."""
    views = panorama.views_of(panorama.paint(), 40)
    hidden = np.zeros(SIZE, bool)
    hidden[PLACE] = True
    shown = measured(pictures_of(views), hidden=[hidden if i % 13 else None for i in range(40)])[0]
    assert shown[PLACE].max() < 2.2
    assert shown[PLACE].max() > 0


def test_the_edge_of_a_mask_is_no_detail():
    """What is hidden is black in all views: its edge would be a slope that stays."""
    views = panorama.views_of(panorama.paint(), 40)
    hidden = np.zeros(SIZE, bool)
    hidden[-12:] = True
    views[:, hidden] = 0
    shown = measured(pictures_of(views), hidden=[hidden] * 40)[0]
    assert shown[~hidden].max() < 2.5
    assert np.median(shown[:-14]) < 1.6


def test_what_chance_leaves_follows_from_the_weights_of_views():
    """Between knots a view counts in part: of n views of weights w chance leaves sum w^2 / (sum w)^2."""
    views = np.random.default_rng(1).uniform(0, 1, (36, *SIZE, 3)).astype(np.float32)
    views[(slice(None), *PLACE)] = np.random.default_rng(2).uniform(0, 1, (12, 12, 3))
    middle = measured(pictures_of(views), knots=3)[1]
    weights = np.array([time_weights(view, 36, 3)[1] for view in range(36)])
    assert middle[22:26, 29:33] == pytest.approx(weights.sum() / np.sqrt((weights**2).sum()), rel=0.03)
