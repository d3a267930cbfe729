"""Rain that stays on the lens: detail that all views share, and pixels that vary less than others."""

import numpy as np
import panorama
import pytest

from deraings.lens.fixed_pattern import fixed_pattern
from deraings.lens.still_pixels import MIN_VIEWS, still_cover
from deraings.lens.time_knots import time_weights
from hydroviews.scene.images import to_uint8
from hydroviews.scene.seeds import generator

SIZE = (panorama.HEIGHT, panorama.WIDTH)
PLACE = (slice(18, 30), slice(25, 37))


def views_of(count):
    return panorama.views_of(panorama.paint(), count)


def measured(views, knots=1, hidden=None):
    return fixed_pattern([to_uint8(view) for view in views], hidden or [None] * len(views), SIZE, knots)


def behind_pattern(views, low=0.2, high=0.8):
    """The views, all of which show the same noise in one place."""
    views[(slice(None), *PLACE)] = np.random.default_rng(2).uniform(low, high, (12, 12, 3))
    return views


def masked(rows, columns=slice(None)):
    hidden = np.zeros(SIZE, bool)
    hidden[rows, columns] = True
    return hidden


@pytest.mark.parametrize("count", [8, 30, 120])
def test_a_clear_lens_shows_what_chance_leaves(count):
    shown = measured(views_of(count))
    assert 1 < np.median(shown) < 1.6  # of the largest around each place
    assert np.quantile(shown, 0.95) < 2.2


def test_what_stays_on_the_lens_shows_the_more_the_more_views_there_are():
    shown = [measured(behind_pattern(views_of(count)))[0] for count in (8, 30, 120)]
    excesses = [each[PLACE].min() / np.median(each) for each in shown]
    assert excesses[0] > 1.5
    assert excesses == sorted(excesses)


def test_what_came_late_stays_from_then_on():
    views = views_of(36)
    behind_pattern(views[18:])
    early, _, late = measured(views, knots=3)
    assert np.median(early[PLACE]) < 1.6
    assert late[PLACE].min() > 2


def test_cameras_that_do_not_move_show_no_place_that_stays():
    still = np.repeat(views_of(1), 12, axis=0)
    assert np.median(measured(still)) < 1.3


def test_nothing_is_said_of_what_is_always_hidden_nor_of_grey_pictures():
    views = views_of(12)
    views[(slice(None), *PLACE)] = 0.5
    shown = measured(views, hidden=[masked(*PLACE)] * 12)[0]
    assert not shown[20:28, 27:35].any()
    assert (np.abs(measured(np.full((12, *SIZE, 3), 128 / 255, np.float32))) < 1.2).all()


def test_a_place_that_few_views_show_says_no_more_than_its_share():
    """Few gradients leave more of their mean by chance."""
    hidden = [masked(*PLACE) if i % 13 else None for i in range(40)]
    assert 0 < measured(views_of(40), hidden=hidden)[0][PLACE].max() < 2.2


def test_the_edge_of_a_mask_is_no_detail():
    """Hidden pixels are black in all views: their edge would be a slope that stays."""
    views, hidden = views_of(40), masked(slice(-12, None))
    views[:, hidden] = 0
    shown = measured(views, hidden=[hidden] * 40)[0]
    assert shown[~hidden].max() < 2.5
    assert np.median(shown[:-14]) < 1.6


def test_what_chance_leaves_follows_from_the_weights_of_views():
    """Between knots a view counts in part: of n views of weights w chance leaves sum w^2 / (sum w)^2."""
    views = np.random.default_rng(1).uniform(0, 1, (36, *SIZE, 3)).astype(np.float32)
    middle = measured(behind_pattern(views, 0, 1), knots=3)[1]
    weights = np.array([time_weights(view, 36, 3)[1] for view in range(36)])
    assert middle[22:26, 29:33] == pytest.approx(weights.sum() / np.sqrt((weights**2).sum()), rel=0.03)


SMALL = 48, 64
DROP = slice(20, 24), slice(30, 34)


def moving_scene(views: int = 24) -> np.ndarray:
    """[V, H, W, 3] in [0.2, 0.8]: what lies behind a pixel is new in every view."""
    return generator(0, "moving scene").uniform(0.2, 0.8, (views, *SMALL, 3))


def behind_drop(pictures: np.ndarray, cover: float) -> list[np.ndarray]:
    """The pictures behind a drop of dark light of its own at DROP, as 8 bits."""
    covered = pictures.copy()
    covered[:, *DROP] = (1 - cover) * covered[:, *DROP] + cover * 0.1
    return list(to_uint8(covered))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_drop_takes_as_much_of_the_variation_as_it_covers(share):
    cover = still_cover(behind_drop(moving_scene(), share))
    assert abs(cover[DROP].mean() - share) < 0.12
    cover[DROP] = 0
    assert cover.mean() < 0.1


def test_mist_over_half_of_the_lens_is_no_drop_and_hides_none():
    pictures = moving_scene()
    pictures[:, :, 32:] = 0.4 * pictures[:, :, 32:] + 0.5
    assert (still_cover(list(to_uint8(pictures))) > 0.5).mean() < 0.05
    assert still_cover(behind_drop(0.4 * moving_scene() + 0.5, 1.0))[DROP].mean() > 0.7


def test_few_views_say_nothing():
    assert not still_cover(behind_drop(moving_scene(MIN_VIEWS - 1), 1.0)).any()


def test_hidden_pixels_do_not_count():
    pictures = behind_drop(moving_scene(), 0.0)
    masks = [np.zeros(SMALL, bool) for _ in pictures]
    for picture, mask in zip(pictures[::2], masks[::2], strict=True):
        picture[DROP], mask[DROP] = 0, True
    assert still_cover(pictures, masks)[DROP].mean() < 0.3
    for mask in masks:
        mask[DROP] = True
    assert not still_cover(pictures, masks)[DROP].any()
