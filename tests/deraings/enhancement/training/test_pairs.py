import numpy as np
import pytest
import torch
from wet import HEIGHT, WIDTH, lens, photograph

from baselines.supervised.training import draw_ahead
from deraings.enhancement.training.pair_folders import PairFolder, find_pairs
from deraings.enhancement.training.pairs import MISTED, Batches, Pairs, sensed, stored
from hydroviews.errors import InputError
from hydroviews.pairs.drawing import Pair, shares_without
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.scene.images import write_png
from hydroviews.scene.seeds import generator


def test_a_pair_depends_on_seed_and_number_alone():
    sides = {384: photograph(0, 256, 384), 480: photograph(1, 320, 480)}
    pool = {(384, 256): (lens(True, 256, 384),), (480, 320): (lens(True, 320, 480),)}
    source = DrawnRain([sides], pool, shares_without("window"))
    first = Pairs(source, [], 64, seed=0)
    for batch in draw_ahead(Batches(first, 2), 3, 4, workers=0):
        assert batch.rainy.shape == batch.clean.shape == batch.cover.shape == (2, 3, 64, 64)
        assert batch.whole_rainy.shape == batch.whole_clean.shape == (2, 1 + MISTED, 3, 128, 128)
        assert np.array_equal(batch.rainy[1], Pairs(source, [], 64, seed=0)[7][0])
    few = Pairs(source, [], 64, seed=0, misted=0)[7]
    assert few.whole_rainy.shape == (1, 3, 128, 128)
    assert np.array_equal(few.rainy, first[7].rainy)
    assert not np.array_equal(first[0][0], Pairs(source, [], 64, seed=1)[0][0])


class Ramp(DrawnRain):
    """A picture whose values say where they are."""

    def __init__(self):
        super().__init__([{96: photograph()}], {})

    def pair(self, rng):
        rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
        picture = np.stack([(rows + 0.5) / HEIGHT, (columns + 0.5) / WIDTH, np.ones_like(rows)], axis=-1)
        halves = picture.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean((1, 3))
        return Pair(picture, picture, picture, np.zeros((HEIGHT, WIDTH, 4), np.float32), halves[None])


def test_a_part_is_where_its_box_says():
    mirrored = 0
    for index in range(20):
        sample = Pairs(Ramp(), [], 32, 0)[index]
        top, bottom, left, right = sample.box.tolist()
        assert (bottom - top, right - left) == pytest.approx((32 / HEIGHT, 32 / WIDTH))
        assert sample.rainy[0].mean() == pytest.approx((top + bottom) / 2, abs=1e-5)
        is_mirrored = bool(sample.rainy[1, 0, 0] > sample.rainy[1, 0, -1])
        middle = float(sample.rainy[1].mean())
        assert (1 - middle if is_mirrored else middle) == pytest.approx((left + right) / 2, abs=1e-5)
        assert bool(sample.whole_rainy[0, 1, 0, 0] > sample.whole_rainy[0, 1, 0, -1]) == is_mirrored
        halves = torch.nn.functional.avg_pool2d(sample.rainy, 2)
        assert torch.allclose(sample.fine[:3], halves, atol=1e-5)  # the means of a picture and another like it
        assert bool(sample.coarse[0, 1, 0, 0] > sample.coarse[0, 1, 0, -1]) == is_mirrored
        mirrored += is_mirrored
    assert 0 < mirrored < 20


def write_pairs(folder, names):
    for i, name in enumerate(names):
        write_png(folder / name, photograph(i))


@pytest.mark.parametrize(
    ("rainy", "clean"),
    [
        ("train/input/0001.png", "train/target/0001.png"),  # 4K-Rain13k, UAV-Rain1k
        ("train/rain/norain-1x2.png", "train/norain/norain-1.png"),  # Rain100 in parts
        ("train/rainy/rain-001.png", "train/clean/norain-001.png"),
        ("train/rain-001.png", "train/norain-001.png"),  # the first release of Rain100
        ("train/input/12_3.png", "train/gt/12.png"),  # several rains of one photograph
    ],
)
def test_published_pairs_are_found(tmp_path, rainy, clean):
    write_pairs(tmp_path, [rainy, clean])
    assert find_pairs(tmp_path / "train") == [(tmp_path / rainy, tmp_path / clean)]


def test_published_pairs_that_do_not_fit_are_refused(tmp_path):
    write_pairs(tmp_path, ["input/a.png", "input/b.png", "target/a.png"])
    with pytest.raises(InputError, match="no clean picture"):
        find_pairs(tmp_path)
    (tmp_path / "input/b.png").unlink()
    write_png(tmp_path / "target/a.png", photograph(0))
    rainy, clean, cover, mist, companions = PairFolder(tmp_path, 32).pair(generator(0))
    assert companions.shape == (0, HEIGHT // 2, WIDTH // 2, 3)
    assert rainy.shape == cover.shape == (HEIGHT, WIDTH, 3)
    assert np.isnan(cover).all()
    assert np.isnan(mist).all()
    np.testing.assert_array_equal(rainy, clean)
    with pytest.raises(InputError, match="too small"):
        PairFolder(tmp_path, 128).pair(generator(0))
    with pytest.raises(InputError, match="no rainy and clean"):
        find_pairs(tmp_path / "target")


def test_a_rainy_picture_belongs_to_the_clean_one_whose_name_it_continues_furthest(tmp_path):
    write_pairs(tmp_path, ["input/1_2_3.png", "target/1.png", "target/1_2.png"])
    ((_, clean),) = find_pairs(tmp_path)
    assert clean.name == "1_2.png"


@pytest.mark.parametrize("change", [stored, sensed])
def test_a_camera_changes_a_pair_with_its_companions(change):
    """A lens is known from photographs as they are taken and stored, too."""
    rng = np.random.default_rng(0)
    sizes = (32, 48, 3), (32, 48, 3), (32, 48, 3), (32, 48, 4), (2, 16, 24, 3)
    pair = Pair(*(rng.random(size).astype(np.float32) for size in sizes))
    found = change(pair, rng)
    for before, after in ((pair.rainy, found.rainy), (pair.companions, found.companions)):
        assert 1e-3 < np.abs(before - after).mean() < 0.3
    assert change(pair._replace(rainy=pair.clean), rng).companions is pair.companions
