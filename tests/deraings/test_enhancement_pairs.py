import numpy as np
import pytest
from scipy.sparse import csr_array

from deraings.enhancement.pair_folders import PairFolder, find_pairs
from deraings.enhancement.pairs import VEILED, DrawnRain, Pairs, batches, exposed
from deraings.enhancement.photographs import fit_frame, frame_of, frames, read_photographs, split_photographs
from deraings.enhancement.rain import (
    KINDS,
    LINEAR,
    Pair,
    WetLens,
    air_light,
    camera_of,
    draw_mist,
    draw_rain,
    draw_veil,
    wet_lens,
)
from deraings.enhancement.validation import rain_on, setting_of
from hydroviews.errors import InputError
from hydroviews.images import to_linear, to_srgb, write_png
from hydroviews.rain.drops_pattern import draw_pattern
from hydroviews.rain.lens_bake import moment_of
from hydroviews.rain.mist import mist_veil
from hydroviews.rain.path_matte import PathMatte, dry
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.seeds import generator

WIDTH, HEIGHT = 96, 64


def photograph(seed: int = 0, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    coarse = np.random.default_rng(seed).integers(20, 235, (height // 8, width // 8, 3))
    return coarse.repeat(8, 0).repeat(8, 1).astype(np.uint8)


def lens(drops: bool = True, height: int = HEIGHT, width: int = WIDTH) -> WetLens:
    """A lens with one square drop that shows the picture's first pixel, or none."""
    pattern = draw_pattern(np.random.default_rng(0))
    if not drops:
        return WetLens(pattern, 0, dry(height, width))
    mask = np.zeros((height, width), np.float32)
    mask[20:40, 30:50] = 1
    pixels = np.flatnonzero(mask)
    paths = csr_array((np.ones(len(pixels), np.float32), (np.arange(len(pixels)), np.zeros(len(pixels), int))))
    paths = csr_array((paths.data, paths.indices, paths.indptr), shape=(len(pixels), mask.size))
    return WetLens(pattern, 0, PathMatte(mask, np.zeros_like(mask), pixels, paths, 0.0))


@pytest.mark.parametrize("kind", KINDS)
def test_rain_changes_what_it_should(kind):
    rainy, clean, cover, veil = draw_rain(photograph(), kind, [lens()], generator(3, kind))
    np.testing.assert_array_equal(clean, photograph().astype(np.float32) / 255)
    assert rainy.shape == clean.shape
    assert rainy.min() >= 0
    assert rainy.max() <= 1
    assert np.array_equal(rainy, clean) == (kind == "clean")
    assert cover.min() >= 0
    assert cover.max() <= 1
    assert (cover[..., 0] > 0).any() == (kind in ("streak", "both"))
    assert (cover[..., 1] > 0).any() == (kind in ("raindrop", "both"))
    assert np.isnan(veil).all() == (kind in ("streak", "both"))
    if kind == "raindrop":
        np.testing.assert_array_equal(veil[..., 0], cover[..., 2])
    dry_pixels = cover.max(axis=-1) == 0
    np.testing.assert_allclose(rainy[dry_pixels], clean[dry_pixels], atol=1e-6)


def test_mist_is_composited_in_linear_light_with_the_light_of_the_air():
    picture, wet = photograph(), lens(drops=False)
    pattern = draw_mist(wet, generator(5))
    assert pattern.mist > 0
    rainy, mask, found = wet_lens(picture, wet, generator(5))
    assert not mask.any()
    veil = mist_veil(pattern, WIDTH, HEIGHT, moment_of(pattern, 0))[..., None]
    linear = to_linear(picture.astype(np.float32) / 255)
    air = air_light(linear) * np.array(pattern.air, np.float32)
    np.testing.assert_allclose(rainy, to_srgb((1 - veil) * linear + veil * air), atol=1e-5)
    np.testing.assert_allclose(found, np.concatenate([veil, veil * air], axis=-1), atol=1e-6)


def test_drops_show_what_light_paths_bring():
    picture = photograph()
    dry_mist = next(seed for seed in range(100) if draw_mist(lens(), generator(seed)).mist == 0)
    rainy, mask, _ = wet_lens(picture, lens(), generator(dry_mist))
    np.testing.assert_array_equal(mask, lens().matte.mask)
    np.testing.assert_allclose(rainy[30, 40], picture[0, 0] / 255, atol=1e-3)
    np.testing.assert_allclose(rainy[:20], picture[:20] / 255, atol=1e-3)


def test_small_pictures_in_mist_are_brighter_where_it_is_and_sometimes_dry():
    picture = photograph(0, 128, 192)
    pairs = [draw_veil(picture, generator(seed)) for seed in range(20)]
    assert {pair[0].shape for pair in pairs} == {(128, 128, 3)}
    dry_ones = [pair for pair in pairs if not pair[2].any()]
    misty_ones = [pair for pair in pairs if pair[2].any()]
    assert 0 < len(dry_ones) < 10
    assert all(np.array_equal(rainy, clean) for rainy, clean, _ in dry_ones)
    contrast = [float(rainy.std() / clean.std()) for rainy, clean, _ in misty_ones]
    assert max(contrast) < 1
    assert min(contrast) < 0.7
    assert np.mean([clean.mean() for _, clean, _ in pairs]) < picture.mean() / 255  # shorter exposures


def test_strengths_cover_the_grades():
    levels = [draw_mist(lens(), generator(seed, "mist")).mist for seed in range(300)]
    assert 0.05 < np.mean(np.array(levels) == 0) < 0.3
    assert max(levels) > 0.85
    assert 0.03 < np.median(levels) < 0.3


def test_linear_table_is_the_encoding():
    np.testing.assert_allclose(to_srgb(LINEAR) * 255, np.arange(256), atol=1e-3)


def test_frames_are_the_benchmarks_size_in_both_directions(tmp_path):
    assert set(frames()) == {(480, 320), (320, 480), (384, 256), (256, 384)}
    assert frame_of(321, 481, 480) == (320, 480)
    image = np.random.default_rng(0).random((481, 321, 3)).astype(np.float32)
    assert fit_frame(image, (320, 480)).shape == (480, 320, 3)
    with pytest.raises(ValueError, match="enlarge"):
        fit_frame(image, (480, 320))
    write_png(tmp_path / "small.png", image[:100, :100])
    with pytest.raises(InputError, match="too small"):
        read_photographs([tmp_path / "small.png"])


def test_every_tenth_photograph_by_name_is_held_out(tmp_path):
    for i in range(25):
        write_png(tmp_path / f"{i:02d}.png", photograph(i))
    split = split_photographs(tmp_path)
    assert [file.stem for file in split.held_out] == ["00", "10", "20"]
    assert len(split.training) == 22
    with pytest.raises(InputError, match="no such folder"):
        split_photographs(tmp_path / "nothing")


def test_exposures_are_darker_and_keep_order():
    picture = photograph()
    darker = exposed(picture, generator(0))
    assert (darker <= picture).all()
    assert darker.mean() > 0.3 * picture.mean()


def test_a_pair_depends_on_seed_and_number_alone():
    sides = {384: photograph(0, 256, 384), 480: photograph(1, 320, 480)}
    pool = {(384, 256): (lens(True, 256, 384),), (480, 320): (lens(True, 320, 480),)}
    source = DrawnRain([sides], pool)
    first = Pairs(source, [], 64, seed=0)
    for batch in batches(first, 2, 3, 4, workers=0):
        assert batch.rainy.shape == batch.clean.shape == batch.cover.shape == (2, 3, 64, 64)
        assert batch.whole_rainy.shape == batch.whole_clean.shape == (2, 1 + VEILED, 3, 128, 128)
        assert np.array_equal(batch.rainy[1], Pairs(source, [], 64, seed=0)[7][0])
    few = Pairs(source, [], 64, seed=0, veiled=0)[7]
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
        return Pair(picture, picture, picture, np.zeros((HEIGHT, WIDTH, 4), np.float32))


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
    rainy, clean, cover, veil = PairFolder(tmp_path, 32).pair(generator(0))
    assert rainy.shape == cover.shape == (HEIGHT, WIDTH, 3)
    assert np.isnan(cover).all()
    assert np.isnan(veil).all()
    np.testing.assert_array_equal(rainy, clean)
    with pytest.raises(InputError, match="too small"):
        PairFolder(tmp_path, 128).pair(generator(0))
    with pytest.raises(InputError, match="no rainy and clean"):
        find_pairs(tmp_path / "target")


def test_graded_streaks_get_harder_with_the_grade(tmp_path):
    write_png(tmp_path / "a.png", photograph(0, 256, 384))
    image = photograph(0, 256, 384).astype(np.float32) / 255
    setting = setting_of(tmp_path / "a.png", image, 0)
    assert setting.views[0].camera.width == camera_of((384, 256)).width == 384
    harm = [float(np.mean((rain_on(image, Pattern("streak", i), setting, tmp_path) - image) ** 2)) for i in range(3)]
    assert harm[0] < harm[1] < harm[2]
