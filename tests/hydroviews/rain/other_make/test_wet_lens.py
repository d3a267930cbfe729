from dataclasses import replace

import cv2
import numpy as np
import pytest
from synthetic import capture_in

from hydroviews.rain.effect import fall
from hydroviews.rain.other_make.drops import KEY_FRAMES, Drops, draw_pattern, drops_on
from hydroviews.rain.other_make.lens import aperture, map_lens, see_through
from hydroviews.rain.other_make.mist import mist_cover
from hydroviews.rain.other_make.raindrop import ADDED, OtherRaindrops, WetLens
from hydroviews.rain.other_make.refraction import Bodies
from hydroviews.rain.other_make.severity import THICKEST_MIST, drops_harm
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import survey
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator

EFFECT = OtherRaindrops()
PATTERN = replace(draw_pattern(generator(3, "lens"), 1), mist=0.4, key_frames=1)
SHARP = replace(PATTERN, focus_blur=1e-6, aperture_blades=0)


@pytest.fixture
def statistics(tmp_path):
    return survey(capture_in(tmp_path / "yard"), 0)


def camera(width, height, focal=1.2):
    long = focal * max(width, height)
    return Camera(width, height, long, long, width / 2, height / 2, np.eye(4))


def waves(width, height):
    y, x = np.mgrid[0:height, 0:width] + 0.5
    planes = (x / width, y / height, 0.5 + 0.5 * np.sin(9 * x / width))
    return np.stack(planes, axis=-1).astype(np.float32)


def one_drop(place=(0.0, 0.0), radius=0.2, contact=0.9, meniscus=False):
    body = Bodies(np.eye(2)[None], np.zeros((1, 2)), np.array([contact]), np.array([meniscus]))
    return Drops(np.array([place]), np.array([radius]), body)


def seen(drops, width=120, height=90, pattern=SHARP, clean=None):
    lens = map_lens(pattern, drops, camera(width, height))
    return see_through(lens, waves(width, height) if clean is None else clean, pattern)


def test_a_drop_covers_its_disk():
    cover, _ = seen(one_drop(radius=0.2), 240, 180)
    assert cover.mean() == pytest.approx(np.pi * 0.2**2, rel=0.01)
    assert cover[90, 120] == 1
    assert cover[:20].max() == 0


def test_a_drop_shows_the_scene_upside_down():
    """Left in it is what is right behind it; waves are redder to the right and greener below."""
    _, light = seen(one_drop())
    assert light[45, 52, 0] > light[45, 68, 0] + 0.1
    assert light[37, 60, 1] > light[53, 60, 1] + 0.1


def test_rims_are_dark_and_highlights_bright():
    white = np.ones((90, 120, 3), np.float32)
    dull = replace(SHARP, glint=0.0)
    cover, light = seen(one_drop(contact=1.2), pattern=dull, clean=white)
    shown = np.where(cover[..., None] > 0.9, light / np.maximum(cover, 0.5)[..., None], np.nan)
    assert np.nanmin(shown) < 0.4
    assert shown[45, 60, 0] == pytest.approx(0.98, abs=0.02)
    grey = np.full((90, 120, 3), 0.3, np.float32)
    shine = seen(one_drop(), pattern=replace(SHARP, glint=0.5), clean=grey)[1]
    assert (shine - seen(one_drop(), pattern=dull, clean=grey)[1]).max() > 0.2


def test_no_cover_is_no_change(statistics):
    dry = replace(PATTERN, coverage=0.0, mist=0.0)
    assert len(drops_on(dry, 48, 36, 0.5).radii) == 0
    assert drops_harm(dry, statistics) == 0
    view = statistics.views[2]
    clean, rain = view.image(), WetLens(dry, statistics)
    layers = fall(rain.prepare(view.camera, view.path.parent), clean, view)
    assert all(plane.max() == 0 for plane in layers.values())
    np.testing.assert_array_equal(EFFECT.composite(rain.parameters, clean, layers), clean)


@pytest.mark.parametrize("meniscus", [False, True])
def test_a_drop_over_the_whole_picture(meniscus):
    cover, light = seen(one_drop(radius=3.0, contact=0.5, meniscus=meniscus))
    assert cover.min() == 1
    assert np.isfinite(light).all()
    assert light.std() > 0.02


def test_the_border_cuts_a_drop_as_a_larger_picture_would():
    """A drop at the border, and the same one inside a picture that goes on there."""
    cover, _ = seen(one_drop((-0.5 * np.sqrt(4 / 3), 0.0), 0.15), 120, 90)
    side = np.sqrt(120 * 90)
    wide, _ = seen(one_drop((-60 / np.sqrt(240 * 90), 0.0), 0.15 * side / np.sqrt(240 * 90)), 240, 90)
    assert cover[45, 0] == 1
    np.testing.assert_allclose(cover[:, 2:60], wide[:, 62:120], atol=0.02)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_black_and_white_pictures(value):
    plain = np.full((90, 120, 3), value, np.float32)
    cover, light = seen(drops_on(PATTERN, 120, 90, 0.0), pattern=PATTERN, clean=plain)
    assert 0 <= light.min() <= light.max() <= 1
    if value == 0:
        assert 0 < light.max() <= PATTERN.glint  # nothing but highlights
    else:
        assert (light.mean(axis=-1) <= cover + 1e-5).all()


@pytest.mark.parametrize("size", [(1, 1), (64, 1), (1, 64), (17, 15)])
def test_any_size_of_picture(size):
    cover, light = seen(drops_on(PATTERN, *size, 0.0), *size, pattern=PATTERN)
    mist = mist_cover(PATTERN, *size, 0.0)
    assert cover.shape == mist.shape == size[::-1]
    assert np.isfinite(light).all()
    assert 0 <= mist.min() <= mist.max() <= np.float32(PATTERN.mist)


def test_a_very_long_lens_shows_hardly_any_of_the_scene_but_what_drops_bend_in():
    lens = map_lens(SHARP, one_drop(), camera(120, 90, focal=200.0))
    cover, light = see_through(lens, waves(120, 90), SHARP)
    assert cover.max() == 1
    assert np.isfinite(light).all()


@pytest.mark.parametrize("blades", [0, 6])
def test_the_same_lens_at_another_size(blades):
    pattern = replace(PATTERN, aperture_blades=blades)
    large = seen(drops_on(pattern, 640, 480, 0.3), 640, 480, pattern)
    small = seen(drops_on(pattern, 320, 240, 0.3), 320, 240, pattern)
    halved = [cv2.resize(plane, (320, 240), interpolation=cv2.INTER_AREA) for plane in large]
    for one, other in zip(small, halved, strict=True):
        assert np.abs(one - other).mean() < 0.002
        assert np.sqrt(np.mean((one - other) ** 2)) < 0.01
    mists = mist_cover(pattern, 640, 480, 0.3), mist_cover(pattern, 320, 240, 0.3)
    np.testing.assert_allclose(cv2.resize(mists[0], (320, 240), interpolation=cv2.INTER_AREA), mists[1], atol=0.01)


def test_coverage_is_what_was_asked_for_and_more_adds_drops():
    some = drops_on(replace(PATTERN, clustered=0.0, coverage=0.1), 400, 300, 0.0)
    more = drops_on(replace(PATTERN, clustered=0.0, coverage=0.15), 400, 300, 0.0)
    np.testing.assert_array_equal(more.places[: len(some.radii)], some.places)
    np.testing.assert_array_equal(more.bodies.inverse[: len(some.radii)], some.bodies.inverse)
    assert len(more.radii) > len(some.radii)
    covers = [
        seen(drops_on(replace(PATTERN, seed=seed, clustered=0.0, coverage=0.1), 400, 300, 0.0), 400, 300)[0].mean()
        for seed in range(6)
    ]
    assert np.mean(covers) == pytest.approx(0.1, rel=0.15)


def test_the_blur_keeps_light_and_has_the_aperture_s_form():
    for blades in (0, 5, 8):
        kernel = aperture(replace(PATTERN, aperture_blades=blades, focus_blur=0.05), 300)
        assert kernel.sum() == pytest.approx(1, abs=1e-5)
        assert (kernel > 0).any(axis=0).sum() > 10
    square = aperture(replace(PATTERN, aperture_blades=4, aperture_turn=0.0, focus_blur=0.1), 300)
    assert (square > 0.5 * square.max()).sum() == pytest.approx(2 * 15**2, rel=0.1)  # of circumradius 15


def test_mist_is_coarse_or_fine_and_of_its_own_colour():
    def roughness(coarsest, finest):
        pattern = replace(PATTERN, mist_coarsest=coarsest, mist_finest=finest, mist_contrast=0.2)
        mist = mist_cover(pattern, 320, 240, 0.0)
        return np.abs(np.diff(mist, axis=1)).mean() / mist.std()

    assert roughness(4, 25) > 3 * roughness(1, 4)
    drawn = [draw_pattern(generator(seed, "colours"), 1) for seed in range(100)]
    warmth = [p.mist_colour[0] - p.mist_colour[2] for p in drawn]
    assert min(warmth) < -0.05 < 0.05 < max(warmth)
    assert {p.key_frames for p in drawn} == set(KEY_FRAMES)
    assert 3 not in KEY_FRAMES


def test_drops_stay_or_drift_as_key_frames_say(statistics):
    def covers(key_frames):
        rain = WetLens(replace(PATTERN, key_frames=key_frames), statistics)
        ready = rain.prepare(statistics.views[0].camera, statistics.views[0].path.parent)
        return [ready.layers(view.image(), view)["D"].tobytes() for view in statistics.views]

    assert [len(set(covers(count))) for count in (1, 2, 0)] == [1, 2, len(statistics.views)]


def test_the_rainy_view_is_the_equation_in_encoded_values(statistics):
    """Drops and mist over the view, written out in float64; where there is neither, nothing changes."""
    rain, view = WetLens(replace(PATTERN, mist_contrast=1.0), statistics), statistics.views[1]
    clean = view.image()
    layers = fall(rain.prepare(view.camera, view.path.parent), clean, view)
    drops, mist = (layers[name].astype(np.float64)[..., None] for name in "DF")
    added = np.stack([layers[name] for name in ADDED], axis=-1).astype(np.float64)
    rainy = EFFECT.composite(rain.parameters, clean, layers)
    np.testing.assert_allclose(rainy, np.clip((1 - drops) * (1 - mist) * clean + added, 0, 1), atol=1e-6)
    colour = np.array(PATTERN.mist_colour)
    dry = drops[..., 0] == 0
    expected = clean + mist * (colour - clean)
    np.testing.assert_allclose(rainy[dry], expected[dry], atol=2e-3)
    np.testing.assert_allclose(rainy[(layers["D"] == 0) & (layers["F"] == 0)], clean[dry & (mist[..., 0] == 0)])


def test_grades_are_harder_in_order(statistics):
    light, medium, heavy = (EFFECT.draw(Pattern("raindrop-b", level), statistics) for level in range(3))
    harm = [drops_harm(p, statistics) + p.mist**2 for p in (light, medium, heavy)]
    assert harm == sorted(harm)
    assert heavy.mist <= THICKEST_MIST
