from dataclasses import replace

import numpy as np
import pytest
from synthetic import capture_in

from hydroviews.rain import effects, severity
from hydroviews.rain.lens.mist import mist_veil
from hydroviews.rain.light import luminance
from hydroviews.rain.patterns import GRADES, Pattern
from hydroviews.rain.scene_statistics import TINT, survey
from hydroviews.rain.seeds import generator
from hydroviews.rain.streaks.effect import streak_layer
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import to_linear, to_srgb, write_png


@pytest.fixture
def setting(tmp_path):
    scene = capture_in(tmp_path / "yard")
    return survey(scene, 0)


def harm(drawn, setting) -> float:
    """Square of the mean light that streaks add, measured on fresh views and not on those of the calibration."""
    camera = setting.views[0].camera
    layers = np.stack([streak_layer(drawn, camera.width, camera.height, generator(9, i)) for i in range(20)])
    return severity.learned_cover(layers, setting.mean_inverse_visibility) * severity.mean_squared_contrast(
        setting, drawn.brightness
    )


def test_streaks_are_as_harmful_as_their_grade_says(setting):
    drawn = [effects.draw(Pattern("streak", i), setting) for i in range(3)]
    reached = 0
    for grade, pattern in zip(GRADES, drawn, strict=True):
        wanted = severity.wanted_harm("streak", grade, setting)
        if severity.FEWEST < pattern.n < severity.MOST or pattern.brightness < severity.BRIGHTEST:
            reached += 1
            assert harm(pattern, setting) == pytest.approx(wanted, rel=0.5)
    assert reached >= 2
    assert harm(drawn[0], setting) < harm(drawn[1], setting) < harm(drawn[2], setting)


def test_grades_repeat_every_three_patterns():
    assert [Pattern("streak", i).grade for i in range(4)] == ["light", "medium", "heavy", "light"]


def test_a_pattern_is_the_same_whenever_it_is_drawn(setting):
    first = [effects.draw(Pattern("streak", i), setting) for i in (0, 1)]
    assert [effects.draw(Pattern("streak", i), setting) for i in (1, 0)] == first[::-1]


@pytest.mark.parametrize(("wanted", "expected"), [(4.0, 2.0), (0.0, 1.0), (100.0, 5.0)])
def test_solve_finds_the_value_or_the_nearest_end(wanted, expected):
    assert severity.solve(lambda x: x * x, wanted, 1.0, 5.0) == pytest.approx(expected, abs=0.01)


def test_a_survey_measures_light_and_detail(tmp_path):
    scene = capture_in(tmp_path / "yard")
    half = np.zeros((scene.views[0].camera.height, scene.views[0].camera.width, 3), np.float32)
    half[: len(half) // 6] = 0.8  # bright above, black below
    for view in scene.views:
        write_png(view.path, half)
    found = survey(scene, 0)
    bright = float(to_linear(np.float32([204 / 255]))[0])
    assert found.light.air == pytest.approx((bright,) * 3, rel=0.2)
    assert 0 < found.light.mean[0] < 0.25 * bright
    flat = [np.full_like(half, 0.5)] * len(scene.views)
    for view, image in zip(scene.views, flat, strict=True):
        write_png(view.path, image)
    assert survey(scene, 0).detail == pytest.approx(0, abs=1e-9)


def test_the_air_is_as_bright_as_the_brightest_tenth_and_hardly_coloured(tmp_path):
    scene = capture_in(tmp_path / "yard")
    red = np.zeros((scene.views[0].camera.height, scene.views[0].camera.width, 3), np.float32)
    red[: len(red) // 4] = (0.8, 0.2, 0.2)  # petals
    for view in scene.views:
        write_png(view.path, red)
    petals = to_linear(np.float32([[204 / 255, 51 / 255, 51 / 255]]))[0]
    air = np.array(survey(scene, 0).light.air)
    assert luminance(air) == pytest.approx(luminance(petals), rel=0.01)
    assert np.ptp(air) == pytest.approx(TINT * np.ptp(petals), rel=0.01)


def test_mist_is_as_harmful_as_its_grade_says(setting):
    drawn = [effects.draw(Pattern("raindrop", i), setting) for i in range(3)]
    air = np.array(setting.light.air, np.float32)
    harms = []
    for grade, pattern in zip(GRADES, drawn, strict=True):
        changes = []
        for sample in setting.samples:  # the composite's own formula, written out
            veil = mist_veil(pattern, sample.shape[1], sample.shape[0], 0.5)[..., None]
            veiled = to_srgb((1 - veil) * to_linear(sample) + veil * air * np.float32(pattern.air))
            changes.append(np.mean((veiled - sample) ** 2))
        harms.append(np.mean(changes))
        drops = severity.drops_harm(pattern.coverage, setting)
        if pattern.mist < severity.THICKEST_MIST:
            assert harms[-1] + drops == pytest.approx(severity.wanted_harm("raindrop", grade, setting), rel=0.1)
    assert harms[0] < harms[1] < harms[2]
    assert max(pattern.mist for pattern in drawn) < severity.THICKEST_MIST


def test_rarity_counts_the_training_views_that_see_a_point(tmp_path):
    scene = capture_in(tmp_path / "yard")  # a ring around all points: every view sees nearly every one
    found = survey(scene, 0)
    assert 1 / len(scene.split.train) <= found.mean_inverse_visibility < 1.2 / len(scene.split.train)
    for view in scene.train_views[1:]:  # a wall in front of all but one
        write_depth(depth_path(view), np.full((view.camera.height, view.camera.width), 0.5))
    assert survey(scene, 0).mean_inverse_visibility == pytest.approx(1, abs=1e-6)


def test_a_scene_that_is_learned_well_needs_less_rain_for_a_grade(setting):
    well = replace(setting, clean_error=severity.LEARNED / 3)
    for effect in severity.LOSS:
        for grade in GRADES:
            wanted = severity.wanted_harm(effect, grade, setting)
            assert severity.wanted_harm(effect, grade, well) == pytest.approx(wanted / 3)
    assert effects.draw(Pattern("streak", 1), well).n < effects.draw(Pattern("streak", 1), setting).n


def test_a_scene_that_drops_harm_more_gets_fewer_of_them(setting):
    dear = replace(setting, drops_cost=3.0)
    assert severity.drops_harm(0.1, dear) == pytest.approx(3 * severity.drops_harm(0.1, setting))
    usual, fewer = (effects.draw(Pattern("raindrop", 0), s) for s in (setting, dear))
    assert fewer.coverage < usual.coverage or fewer.mist < usual.mist
