from dataclasses import replace

import numpy as np
import pytest

from hydroviews.rain.effect import fall
from hydroviews.rain.other_make.drops import Drops, draw_pattern, drops_on
from hydroviews.rain.other_make.lens import map_lens, see_through
from hydroviews.rain.other_make.raindrop import ADDED, OtherRaindrops, WetLens
from hydroviews.rain.other_make.refraction import Bodies
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator

EFFECT = OtherRaindrops()
PATTERN = replace(draw_pattern(generator(3, "lens"), 1), mist=0.4, key_frames=1)
SHARP = replace(PATTERN, focus_blur=1e-6, aperture_blades=0)


def camera(width, height):
    focal = 1.2 * max(width, height)
    return Camera(width, height, focal, focal, width / 2, height / 2, np.eye(4))


def waves(width, height):
    y, x = np.mgrid[0:height, 0:width] + 0.5
    planes = (x / width, y / height, 0.5 + 0.5 * np.sin(9 * x / width))
    return np.stack(planes, axis=-1).astype(np.float32)


BODY = Bodies(np.eye(2)[None], np.zeros((1, 2)), np.array([0.9]), np.array([False]))
ONE_DROP = Drops(np.zeros((1, 2)), np.array([0.2]), BODY)


def seen(drops, width=120, height=90):
    """Cover and light of sharp drops before waves."""
    return see_through(map_lens(SHARP, drops, camera(width, height)), waves(width, height), SHARP)


def test_a_drop_covers_its_disk():
    cover, _ = seen(ONE_DROP, 240, 180)
    assert cover.mean() == pytest.approx(np.pi * 0.2**2, rel=0.01)
    assert cover[90, 120] == 1
    assert cover[:20].max() == 0


def test_a_drop_shows_the_scene_upside_down():
    """Left in it is what is right behind it; waves are redder to the right and greener below."""
    _, light = seen(ONE_DROP)
    assert light[45, 52, 0] > light[45, 68, 0] + 0.1
    assert light[37, 60, 1] > light[53, 60, 1] + 0.1


def test_coverage_is_what_was_asked_for_and_more_adds_drops():
    def drops(**changes):
        return drops_on(replace(PATTERN, clustered=0.0, **changes), 400, 300, 0.0)

    some, more = drops(coverage=0.1), drops(coverage=0.15)
    np.testing.assert_array_equal(more.places[: len(some.radii)], some.places)
    np.testing.assert_array_equal(more.bodies.inverse[: len(some.radii)], some.bodies.inverse)
    assert len(more.radii) > len(some.radii)
    covers = [seen(drops(seed=seed, coverage=0.1), 400, 300)[0].mean() for seed in range(6)]
    assert np.mean(covers) == pytest.approx(0.1, rel=0.15)


def test_drops_stay_or_drift_as_key_frames_say(statistics):
    def covers(key_frames):
        rain = WetLens(replace(PATTERN, key_frames=key_frames), statistics)
        ready = rain.prepare(statistics.views[0].camera, statistics.views[0].path.parent)
        return [ready.layers(view.image(), view)["D"].tobytes() for view in statistics.views]

    assert [len(set(covers(count))) for count in (1, 2, 0)] == [1, 2, len(statistics.views)]


def test_the_rainy_view_is_the_equation_in_encoded_values(statistics):
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
    assert 0 <= layers["F"].min() <= layers["F"].max() <= np.float32(PATTERN.mist)
    np.testing.assert_allclose(rainy[dry], expected[dry], atol=2e-3)
    np.testing.assert_allclose(rainy[(layers["D"] == 0) & (layers["F"] == 0)], clean[dry & (mist[..., 0] == 0)])
