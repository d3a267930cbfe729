"""The photographs in memory: once, also where their pixels are wanted in one array."""

from dataclasses import replace

import numpy as np
import pytest
from splats import photographed

from baselines.training.images import TrainingImages, evenly_spread, read_images
from hydroviews.errors import InputError
from hydroviews.scene.images import to_uint8
from hydroviews.scene.masks import write_ignored
from hydroviews.scene.scenes import View

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


def test_the_digest_tells_what_is_hidden():
    """Where the hidden pixels are black anyhow, nothing else does."""
    black, mask = np.zeros((4, 6, 3), np.uint8), np.zeros((4, 6), bool)
    assert len({TrainingImages([black], [hidden]).digest() for hidden in (None, mask, ~mask)}) == 3


def test_pictures_are_read_in_eight_bits(tmp_path, monkeypatch):
    """A photograph in float32, larger than its camera, would be there as planes and as a picture at once."""
    views = photographed(tmp_path, n_views=6).views
    expected = [to_uint8(view.image()) for view in views]
    monkeypatch.setattr(View, "image", None)
    images = read_images(views)
    assert all(np.array_equal(images.pixels(index), picture) for index, picture in enumerate(expected))


def test_photographs_that_masks_hide_entirely_are_refused(tmp_path):
    views, hidden = photographed(tmp_path, n_views=6).views, np.ones((36, 48), bool)
    write_ignored(tmp_path / "all.png", hidden)
    write_ignored(tmp_path / "part.png", np.indices(hidden.shape)[0] > 5)
    masked = [replace(view, mask=tmp_path / "all.png") for view in views]
    with pytest.raises(InputError, match=r"no pixel counts\n.*all\.png and the others"):
        read_images(masked)
    for shown in (views[0], replace(views[0], mask=tmp_path / "part.png")):
        assert len(read_images([shown, *masked])) == 7
    assert len(read_images([])) == 0


@pytest.mark.parametrize(
    ("count", "most", "expected"),
    [(0, 3, []), (1, 3, [0]), (3, 8, [0, 1, 2]), (8, 3, [0, 4, 7]), (8, 1, [0]), (9, 5, [0, 2, 4, 6, 8])],
)
def test_what_is_chosen_is_evenly_spread(count, most, expected):
    assert evenly_spread(count, most) == expected
