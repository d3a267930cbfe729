import numpy as np
import pytest

from deraings.lens.still_pixels import MIN_VIEWS, still_cover
from hydroviews.scene.images import to_uint8
from hydroviews.scene.seeds import generator

SIZE = 48, 64
DROP = slice(20, 24), slice(30, 34)


def moving_scene(views: int = 24) -> np.ndarray:
    """[V, H, W, 3] in [0.2, 0.8]: what lies behind a pixel is new in every view."""
    return generator(0, "moving scene").uniform(0.2, 0.8, (views, *SIZE, 3))


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
    masks = [np.zeros(SIZE, bool) for _ in pictures]
    for picture, mask in zip(pictures[::2], masks[::2], strict=True):
        picture[DROP], mask[DROP] = 0, True
    assert still_cover(pictures, masks)[DROP].mean() < 0.3
    for mask in masks:
        mask[DROP] = True
    assert not still_cover(pictures, masks)[DROP].any()
