import numpy as np
import pytest

from hydroviews.errors import InputError
from hydroviews.rain.lens.optics.path_matte import PathMatte, assemble


def paths_off(offset, throughput=1.0, disk=0.0) -> PathMatte:
    """One path for every pixel of a lens that is all under water, to so far from it."""
    y, x = np.mgrid[0:5, 0:7] + 0.5
    places = np.stack([x.ravel(), y.ravel()], -1) + offset
    return assemble(np.ones((5, 7)), np.arange(35), places, np.full(35, throughput), disk)


@pytest.fixture
def picture():
    return np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)


def test_paths_between_pixels_are_bilinear(picture):
    shifted = paths_off((0.25, 0)).apply(picture)
    np.testing.assert_allclose(shifted[:, :-1], 0.75 * picture[:, :-1] + 0.25 * picture[:, 1:], atol=1e-6)


@pytest.mark.parametrize(
    ("offset", "flip"), [((7, 0), 1), ((-7, 0), 1), ((0, 5), 0), ((0, -5), 0), ((28, -10), ())], ids=str
)
def test_the_picture_is_mirrored_beyond_its_borders(picture, offset, flip):
    found = paths_off(offset).apply(picture)
    np.testing.assert_allclose(found, np.flip(picture, axis=flip), atol=1e-6)


def test_light_that_no_path_accounts_for_is_as_bright_as_the_view(picture):
    drops = paths_off(0, throughput=0.25).apply(picture)
    np.testing.assert_allclose(drops, 0.25 * picture + 0.75 * picture.mean(axis=(0, 1)), atol=1e-6)


def test_a_grey_picture_stays_grey_behind_defocused_drops():
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 35, 60)
    throughput = np.full(60, 0.1)
    cover = np.bincount(pixels, throughput, minlength=35).reshape(5, 7) * 1.3
    matte = assemble(np.minimum(cover, 1), pixels, rng.uniform(-20, 20, (60, 2)), throughput, disk=2.6)
    grey = np.full((5, 7, 3), 0.4, np.float32)
    np.testing.assert_allclose((1 - matte.mask[..., None]) * grey + matte.apply(grey), grey, atol=1e-6)


def test_a_matte_comes_back_from_its_file(picture, tmp_path):
    matte = paths_off(0.3, 0.7, disk=2.0)
    matte.save(tmp_path / "matte.npz", "a key")
    loaded, key = PathMatte.load(tmp_path / "matte.npz")
    assert key == "a key"
    assert np.array_equal(loaded.apply(picture), matte.apply(picture))
    assert np.array_equal(loaded.mask, matte.mask)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"not an archive"])
def test_a_damaged_matte_is_named(tmp_path, content):
    (tmp_path / "matte.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"matte\.npz"):
        PathMatte.load(tmp_path / "matte.npz")
