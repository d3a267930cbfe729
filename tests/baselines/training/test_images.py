"""The photographs in memory: once, also where their pixels are wanted in one array."""

import weakref

import numpy as np
import pytest

from baselines.training.images import TrainingImages, evenly_spread
from baselines.volumetric.batches import TrainingPixels
from hydroviews.scene.cameras import Camera

SIZES = ((4, 6), (5, 3), (4, 6))


def pictures():
    return [np.random.default_rng(k).integers(1, 255, (*size, 3), np.uint8) for k, size in enumerate(SIZES)]


def test_all_pixels_are_those_of_the_pictures_which_are_parts_of_them():
    mask = np.zeros(SIZES[1], bool)
    mask[2:] = True
    images = TrainingImages(pictures(), [None, mask, None])
    before = [images.pixels(index).copy() for index in range(3)]
    smaller, digest = images.pixels(0, (2, 3)).copy(), images.digest()
    whole = images.all_pixels()
    assert np.array_equal(whole, np.concatenate([picture.reshape(-1, 3) for picture in before]))
    for index, picture in enumerate(before):
        assert np.array_equal(images.pixels(index), picture)
        assert np.shares_memory(images.pixels(index), whole)
    assert np.array_equal(images.ignored(1), mask)
    assert np.array_equal(images.pixels(0, (2, 3)), smaller)
    assert images.digest() == digest
    assert np.array_equal(images.all_pixels(), whole)


def test_a_field_learns_from_the_pictures_themselves():
    images = TrainingImages(pictures())
    alone = [weakref.ref(images.pixels(index)) for index in range(3)]
    cameras = [Camera(width, height, 5.0, 5.0, width / 2, height / 2, np.eye(4)) for height, width in SIZES]
    pixels = TrainingPixels(cameras, images)
    assert [picture() for picture in alone] == [None] * 3
    assert all(np.shares_memory(pixels._colours, images.pixels(index)) for index in range(3))


@pytest.mark.parametrize(
    ("count", "most", "expected"),
    [(0, 3, []), (1, 3, [0]), (3, 8, [0, 1, 2]), (8, 3, [0, 4, 7]), (8, 1, [0]), (9, 5, [0, 2, 4, 6, 8])],
)
def test_what_is_chosen_is_evenly_spread(count, most, expected):
    assert evenly_spread(count, most) == expected
