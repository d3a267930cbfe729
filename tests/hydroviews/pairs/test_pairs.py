import numpy as np
import pytest
from wet import HEIGHT, WIDTH, lens, photograph

from hydroviews.errors import InputError
from hydroviews.pairs.drawing import FALL, KINDS, LENS, draw_rain, shares_without
from hydroviews.pairs.exposure import LINEAR, air_light
from hydroviews.pairs.photographs import fit_frame, frame_of, frames, read_photographs, split_photographs
from hydroviews.pairs.raindrops import draw_mist, wet_lens
from hydroviews.rain.lens.optics.bake import moment_of
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.scene.images import to_linear, to_srgb, write_png
from hydroviews.scene.seeds import generator

NONE = np.zeros((0, HEIGHT // 2, WIDTH // 2, 3), np.uint8)  # companions


@pytest.mark.parametrize("kind", KINDS)
def test_rain_changes_what_it_should(kind, lenses):
    falls, wets = (bool(set(kind.split("+")) & set(families)) for families in (FALL, LENS))
    drops = mists = 0
    for seed in range(12):
        rainy, clean, cover, mist, companions = draw_rain(photograph(), kind, lenses, generator(seed, kind))
        assert companions.shape == (0, HEIGHT // 2, WIDTH // 2, 3)
        np.testing.assert_array_equal(clean, photograph().astype(np.float32) / 255)
        assert rainy.shape == cover.shape == clean.shape
        assert np.array_equal(rainy, clean) == (kind == "clean")
        assert all(0 <= values.min() <= values.max() <= 1 for values in (rainy, cover))
        assert (cover[..., 0] > 0).any() == falls
        drops, mists = drops + (cover[..., 1] > 0).any(), mists + (cover[..., 2] > 0).any()
        if falls:
            assert np.isnan(mist).all()
        elif not np.isnan(mist).any():
            np.testing.assert_array_equal(mist[..., 0], cover[..., 2])
        dry_pixels = cover.max(axis=-1) == 0
        np.testing.assert_allclose(rainy[dry_pixels], clean[dry_pixels], atol=1e-5)
    assert (drops > 0) == wets
    assert (mists > 0) == (kind not in ("clean", "streak"))


@pytest.mark.parametrize("kind", KINDS)
def test_rain_depends_on_the_seed_alone(kind, lenses):
    given = photograph(), kind, lenses
    companions = np.stack([photograph(1)[::2, ::2]] * 2)
    first, again, other = (draw_rain(*given, generator(seed, kind), companions) for seed in (0, 0, 1))
    for one, same in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, same)
    assert np.array_equal(first.rainy, other.rainy) == (kind == "clean")


@pytest.mark.parametrize("kind", ["window", "pane"])
def test_known_mist_is_all_that_is_between_drops(kind, lenses):
    """The pair's two planes of mist make the rainy picture of the clean one if nothing is blurred."""
    uniform = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    checked = 0
    for seed in range(40):
        rainy, clean, cover, mist, _ = draw_rain(uniform, kind, lenses, generator(seed, kind))
        if np.isnan(mist).any():
            continue
        free = cover[..., 1] == 0
        expected = to_srgb((1 - mist[..., :1]) * to_linear(clean) + mist[..., 1:])
        np.testing.assert_allclose(rainy[free], expected[free], atol=2e-4)
        checked += bool(mist[free].any())
    assert checked > 4


def test_shares_add_up_and_families_can_be_left_out():
    assert sum(KINDS.values()) == pytest.approx(1)
    assert KINDS["window"] + KINDS["raindrop"] + KINDS["streak"] <= 0.4 + 1e-9
    left = shares_without("pane")
    assert left.keys() == KINDS.keys() - {"pane", "streak+pane", "lines+pane"}
    assert sum(left.values()) == pytest.approx(1)
    assert left["window"] / left["clean"] == pytest.approx(KINDS["window"] / KINDS["clean"])
    assert shares_without() == pytest.approx(KINDS)
    with pytest.raises(InputError, match="fog"):
        shares_without("fog")
    with pytest.raises(InputError, match="not all"):
        shares_without(*LENS, *FALL, "clean")


def test_mist_is_composited_in_linear_light_with_the_light_of_the_air():
    picture, wet = photograph(), lens(drops=False)
    pattern = draw_mist(wet, generator(5))
    assert pattern.mist > 0
    rainy, mask, found, _ = wet_lens(picture, air_light(LINEAR[picture]), wet, generator(5), NONE)
    assert not mask.any()
    mist = mist_veil(pattern, WIDTH, HEIGHT, moment_of(pattern, 0))[..., None]
    linear = to_linear(picture.astype(np.float32) / 255)
    air = air_light(linear) * np.array(pattern.air, np.float32)
    np.testing.assert_allclose(rainy, to_srgb((1 - mist) * linear + mist * air), atol=1e-5)
    np.testing.assert_allclose(found, np.concatenate([mist, mist * air], axis=-1), atol=1e-6)


def test_drops_show_what_light_paths_bring():
    picture = photograph()
    dry_mist = next(seed for seed in range(100) if draw_mist(lens(), generator(seed)).mist == 0)
    rainy, mask, *_ = wet_lens(picture, np.ones(3, np.float32), lens(), generator(dry_mist), NONE)
    np.testing.assert_array_equal(mask, lens().matte.mask)
    np.testing.assert_allclose(rainy[30, 40], picture[0, 0] / 255, atol=1e-3)
    np.testing.assert_allclose(rainy[:20], picture[:20] / 255, atol=1e-3)


def test_frames_are_the_benchmarks_size_in_both_directions(tmp_path):
    assert set(frames()) == {(480, 320), (320, 480), (384, 256), (256, 384)}
    assert frames((90,)) == ((90, 60), (60, 90))
    assert frame_of(321, 481, 480) == (320, 480)
    image = np.random.default_rng(0).random((481, 321, 3)).astype(np.float32)
    assert fit_frame(image, (320, 480)).shape == (480, 320, 3)
    with pytest.raises(ValueError, match="enlarge"):
        fit_frame(image, (480, 320))
    path = tmp_path / "small.png"
    write_png(path, image[:100, :100])
    with pytest.raises(InputError, match="too small"):
        read_photographs([path])
    (small,) = read_photographs([path], (90, 60))
    assert {side: picture.shape for side, picture in small.items()} == {90: (60, 90, 3), 60: (40, 60, 3)}


def test_every_tenth_photograph_by_name_is_held_out(tmp_path):
    for i in range(25):
        write_png(tmp_path / f"{i:02d}.png", photograph(i))
    split = split_photographs(tmp_path)
    assert [file.stem for file in split.held_out] == ["00", "10", "20"]
    assert len(split.training) == 22
    with pytest.raises(InputError, match="no such folder"):
        split_photographs(tmp_path / "nothing")
