import cv2
import numpy as np
import panorama
import pytest

from deraings.lens.mist_bounds import MAX_PICTURES, MistBounds, max_mist_alpha, mist_bounds, mist_light

AIR = np.array([0.55, 0.6, 0.65], np.float32)
GRID = 1, 4, 5
COUNT = 12


def pictures_behind(most, count=COUNT):
    """Photographs through mist that rises to `most` at the right."""
    scene = panorama.views_of(panorama.paint(), count)
    return panorama.eight_bit(panorama.misted(scene, panorama.slanted_mist(most), AIR))


def behind_beads(pictures):
    """Photographs behind dark and bright drops of two pixels, each as it is in all views, on a ninth of the lens."""
    wet = np.array(pictures)
    for shade, start in ((5, 2), (255, 5)):
        for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
            wet[:, start + down :: 8, start + across :: 8] = shade
    return list(wet)


def test_mist_is_never_lighter_than_the_dark_things_behind_it():
    pictures, knots = pictures_behind(0.4), np.linspace(0, 0.4, 5)
    bound = max_mist_alpha(pictures, AIR, GRID)[0]
    assert (bound > knots - 0.1).all()
    assert np.abs(bound - knots).max() < 0.2
    hidden = np.zeros(pictures[0].shape[:2], bool)
    hidden[:, :30] = True
    assert np.isnan(max_mist_alpha(pictures, AIR, GRID, [hidden] * COUNT)[0, :, 0]).all()


def test_mist_is_expected_to_be_as_light_as_the_brightest_that_is_not_hidden():
    hidden = np.zeros((16, 32), bool)
    hidden[:, 16:] = True
    pictures = [np.where(hidden[..., None], np.uint8([255] * 3), np.uint8([100] * 3))] * 3
    assert mist_light(pictures) == pytest.approx([1, 1, 1])
    assert mist_light(pictures, [hidden] * 3) == pytest.approx(((100 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-4)


def test_drops_with_light_of_their_own_say_nothing_of_mist():
    pictures = pictures_behind(0.4, 24)
    dry, wet = mist_bounds(pictures), mist_bounds(behind_beads(pictures))
    assert np.abs(wet.colour - dry.colour).max() < 0.05
    assert np.abs(wet.max_alpha - dry.max_alpha).mean() < 0.05
    assert np.corrcoef(wet.max_alpha.ravel(), dry.max_alpha.ravel())[0, 1] > 0.95


def test_places_under_drops_and_beside_them_are_not_dry():
    scene = panorama.views_of(panorama.paint(), 24)
    scene[:, 20:24, 30:34] = 0.02
    bounds = mist_bounds(panorama.eight_bit(scene))
    places = np.array([[32, 22], [35, 22], [10, 10]], np.float32) / (panorama.WIDTH, panorama.HEIGHT)
    assert bounds.dry_at(0, places.astype(np.float32)).tolist() == [False, False, True]


@pytest.mark.parametrize("most", [0.0, 0.4])
def test_places_that_all_photographs_hide_say_nothing_of_mist(most):
    pictures = pictures_behind(most)
    hidden = np.zeros(pictures[0].shape[:2], bool)
    hidden[: int(0.7 * len(hidden))] = True  # mist is alike in all rows
    black = [np.where(hidden[..., None], np.uint8(0), picture) for picture in pictures]
    whole, part = mist_bounds(pictures), mist_bounds(black, [hidden] * COUNT)
    assert part.colour == pytest.approx(whole.colour, abs=0.1)
    assert part.max_alpha[0, -1] == pytest.approx(whole.max_alpha[0, -1], abs=0.1)
    assert np.isfinite(part.possible).all()


def test_photographs_that_hide_everything_may_have_any_mist_that_is_even():
    bounds = mist_bounds(list(np.zeros((8, 30, 40, 3), np.uint8)), [np.ones((30, 40), bool)] * 8)
    assert not bounds.possible.any()
    assert (bounds.max_alpha == 1).all()
    assert np.isfinite(bounds.colour).all()


def test_between_knots_possible_mist_is_linear_in_place_and_time():
    possible = np.float32([[[0, 0.2], [0, 0.2]], [[0.4, 0.6], [0.4, 0.6]]])
    bounds = MistBounds(3, np.ones(3, np.float32), possible, possible, [None] * 3)
    places = np.float32([[0, 0], [0.5, 0.3], [1, 1]])
    assert bounds.at(0, places) == pytest.approx([0, 0.1, 0.2], abs=1e-6)
    assert bounds.at(1, places) == pytest.approx([0.2, 0.3, 0.4], abs=1e-6)
    assert bounds.dry_at(1, places).all()


def test_pictures_of_other_sizes_show_the_same_lens():
    pictures = pictures_behind(0.4)
    smaller = [cv2.resize(pictures[0], (30, 40)), *pictures[1:]]
    mixed, alike = (max_mist_alpha(group, AIR, GRID)[0] for group in (smaller, pictures))
    assert np.abs(mixed - alike).max() < 0.03


def test_of_many_photographs_some_of_all_times_are_looked_at():
    """Only the later half shows something dark."""
    pictures = [np.full((8, 8, 3), 255 * (i < MAX_PICTURES), np.uint8) for i in range(2 * MAX_PICTURES)]
    assert max_mist_alpha(pictures, np.ones(3, np.float32), (1, 2, 2)).max() == 0
