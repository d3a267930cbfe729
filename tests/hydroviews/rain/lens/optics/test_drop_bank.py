"""Baked drops one by one: all of them are the path matte, moved ones are what was moved."""

import numpy as np
import pytest

from hydroviews.errors import InputError
from hydroviews.rain.lens.optics.drop_bank import DropBank, DropPainter, cut
from hydroviews.rain.lens.optics.path_matte import assemble

HEIGHT, WIDTH = 12, 16


@pytest.fixture
def light():
    return np.random.default_rng(1).uniform(0, 2, (HEIGHT, WIDTH, 3)).astype(np.float32)


def traced(margin: int = 0, shift: tuple[int, int] = (0, 0)) -> dict[str, np.ndarray]:
    """Two square drops whose paths end anywhere within two pictures, with a margin and moved by whole pixels."""
    rng = np.random.default_rng(0)
    cover = np.zeros((HEIGHT + 2 * margin, WIDTH + 2 * margin))
    pixels = []
    for x, y in ((2, 3), (9, 6)):
        rows, columns = np.mgrid[y : y + 3, x : x + 3]
        rows, columns = rows + margin + shift[1], columns + margin + shift[0]
        cover[rows, columns] = rng.uniform(0.5, 1, (3, 3))
        pixels.append((rows * cover.shape[1] + columns).ravel())
    pixel = np.repeat(np.concatenate(pixels), 5)
    place = rng.uniform(-2, 2, (len(pixel), 2)) * (WIDTH, HEIGHT) + margin + shift
    return {"cover": cover, "pixel": pixel, "place": place, "throughput": rng.uniform(0.05, 0.1, len(pixel))}


def bank_of(margin: int = 0, shift: tuple[int, int] = (0, 0)) -> DropBank:
    """The two drops, told apart by where they are across."""
    return cut(
        traced(margin, shift), (margin, margin), 2, lambda at: (at[:, 0] > 7 + margin + shift[0]).astype(np.int64)
    )


def painted(bank: DropBank, light, slots=(0, 1), shift=(0, 0)) -> DropPainter:
    painter = DropPainter(light)
    painter.paint(bank, np.array(slots), shift)
    return painter


def test_all_drops_at_their_places_are_the_path_matte(light):
    matte = assemble(*traced().values(), disk=0.0)
    found = painted(bank_of(), light)
    np.testing.assert_allclose(found.mask, matte.mask, atol=1e-6)
    np.testing.assert_allclose(found.radiance, matte.apply(light), atol=1e-5)


@pytest.mark.parametrize("shift", [(3, 1), (-4, -4), (0, 5), (20, 0)])
def test_moved_drops_take_their_light_along_and_the_picture_is_mirrored_only_then(light, shift):
    found = painted(bank_of(margin=4), light, shift=shift)
    if shift == (20, 0):
        assert not found.mask.any()
        return
    there = painted(bank_of(margin=8, shift=shift), light)
    np.testing.assert_allclose(found.mask, there.mask, atol=1e-6)
    np.testing.assert_allclose(found.radiance, there.radiance, atol=1e-5)


def test_water_over_water_hides_it_and_no_light_is_gained(light):
    painter = painted(bank_of(), np.ones_like(light), [0, 0, 1, 1])
    np.testing.assert_allclose(painter.radiance, np.repeat(painter.mask[..., None], 3, 2), atol=1e-5)
    assert painter.mask.max() <= 1


def test_drops_are_kept_and_damage_is_told(tmp_path):
    bank, path = bank_of(), tmp_path / "drops.npz"
    bank.save(path, "key")
    kept, key = DropBank.load(path)
    assert key == "key"
    assert np.array_equal(kept.ends, bank.ends)
    assert np.array_equal(kept.starts, bank.starts)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(InputError, match=r"drops.npz: cannot be read"):
        DropBank.load(path)
