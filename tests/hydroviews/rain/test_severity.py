from dataclasses import replace

import cv2
import numpy as np
import pytest
from rained import harm
from synthetic import capture_in

from hydroviews.rain import severity
from hydroviews.rain.lens.effect import SharpRaindropEffect
from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.severity import blur_harm, drops_harm
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import find_effect
from hydroviews.rain.scene_statistics import TINT, survey
from hydroviews.rain.streaks.recipe import streak_layer
from hydroviews.rain.weather.dark import Dark
from hydroviews.rain.weather.haze import Haze
from hydroviews.rain.weather.night import Lamps
from hydroviews.rain.weather.noise import NoisePattern
from hydroviews.rain.weather.severity import LOSS
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import luminance, to_linear, to_srgb, write_png
from hydroviews.scene.seeds import generator

LOSSES = {"streak": (1.5, 4.0, 8.5), "raindrop": (1.5, 3.7, 8.5)}  # dB that grades stand for
# The error of a scene learned from clean views, over its detail, where nothing is known (docs/rain/index.md).
CLEAN_ERROR = 1.5
VIEWS = 8  # that see a place of the ring, all of them trained on


def draw(effect: str, index: int, statistics):
    return find_effect(effect).draw(Pattern(effect, index), statistics)


def loss(statistics, rainy_views) -> float:
    """dB that the plainest reconstruction loses to rain: every pixel is the mean of the views that see it.

    Args:
        statistics: whose samples are the scene.
        rainy_views: a function from a sample to how VIEWS views show it in rain.
    """
    errors = [np.mean((np.mean(rainy_views(sample), axis=0) - sample) ** 2) for sample in statistics.samples]
    return 10 * np.log10(1 + np.mean(errors) / (CLEAN_ERROR * statistics.detail))


def streaks_over(drawn):
    """Fresh streaks, by no generator that the calibration has, over every view."""
    seeds = iter(range(1000))

    def views(sample):
        height, width = sample.shape[:2]
        layers = [streak_layer(drawn, width, height, generator(9, next(seeds))) for _ in range(VIEWS)]
        return [sample * (1 - s[..., None]) + drawn.brightness * s[..., None] for s in layers]

    return views


def wet_lens_over(drawn, statistics):
    """The lens's mist, and drops that in every view lie elsewhere and show another place; the composite written out."""
    air, rng = np.array(statistics.light.air, np.float32) * np.float32(drawn.air), np.random.default_rng(0)

    def views(sample):
        height, width = sample.shape[:2]
        linear, veil = to_linear(sample), mist_veil(drawn, width, height, 0.5)[..., None]
        rainy = []
        for _ in range(VIEWS):
            drops = rng.random((height, width, 1)) < drawn.coverage
            other = linear.reshape(-1, 3)[rng.integers(height * width, size=(height, width))]
            rainy.append(to_srgb(np.where(drops, other, (1 - veil) * linear + veil * air).astype(np.float32)))
        return rainy

    return views


def test_streaks_cost_a_plain_reconstruction_what_their_grade_says(statistics):
    drawn = [draw("streak", i, statistics) for i in range(3)]
    losses = [loss(statistics, streaks_over(pattern)) for pattern in drawn]
    assert losses[:2] == pytest.approx(LOSSES["streak"][:2], abs=0.5)
    assert losses[1] + 1 < losses[2] <= LOSSES["streak"][2]
    assert (drawn[2].n, drawn[2].brightness) == (300, 1)  # the most; this scene has too little contrast


def test_drops_and_mist_cost_a_plain_reconstruction_what_their_grade_says(statistics):
    losses = [loss(statistics, wet_lens_over(draw("raindrop", i, statistics), statistics)) for i in range(3)]
    assert losses == pytest.approx(LOSSES["raindrop"], abs=0.6)


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize(
    ("name", "effect", "part", "metres", "error"),
    [
        ("dark", Dark(), lambda drawn: replace(drawn, noise=NoisePattern(0.0, 0.0)), 1.0, 0.02),
        ("haze", Haze(), lambda drawn: drawn, 1.0, 0.05),
        ("night", Lamps(), lambda drawn: drawn["night"], 5.0, 0.03),  # a smaller scene is all lit by its lamps
    ],
    ids=["dark", "haze", "night"],
)
def test_weather_changes_views_by_what_its_grade_says(yard, name, effect, part, metres, error, index):
    pattern, yard = Pattern(name, index), replace(yard, metres_per_unit=metres)
    drawn = draw(name, index, yard)
    assert draw(name, index, yard) == drawn
    wanted = severity.wanted_harm(LOSS[name][pattern.grade], yard)
    assert harm(effect, part(drawn), pattern, yard) == pytest.approx(wanted, rel=error)


def surveyed(folder, image):
    """A survey of a ring of views that all show the same."""
    scene = capture_in(folder / "yard")
    for view in scene.views:
        write_png(view.path, image)
    return survey(scene, 0)


def test_a_survey_measures_light_and_detail(tmp_path):
    half = np.zeros((36, 48, 3), np.float32)
    half[:6] = 0.8  # bright above, black below
    light = surveyed(tmp_path, half).light
    bright = float(to_linear(np.float32(204 / 255)))
    assert light.air == pytest.approx((bright,) * 3, rel=0.2)
    assert 0 < light.mean[0] < 0.25 * bright
    assert surveyed(tmp_path, np.full_like(half, 0.5)).detail == pytest.approx(0, abs=1e-9)


def test_the_air_is_as_bright_as_the_brightest_tenth_and_hardly_coloured(tmp_path):
    red = np.zeros((36, 48, 3), np.float32)
    red[:9] = (0.8, 0.2, 0.2)  # petals
    petals = to_linear(np.float32([[204 / 255, 51 / 255, 51 / 255]]))[0]
    air = np.array(surveyed(tmp_path, red).light.air)
    assert luminance(air) == pytest.approx(luminance(petals), rel=0.01)
    assert np.ptp(air) == pytest.approx(TINT * np.ptp(petals), rel=0.01)


def test_visibility_counts_the_training_views_that_see_a_point(tmp_path):
    scene = capture_in(tmp_path / "yard")  # a ring around all points: every view sees nearly every one
    found = survey(scene, 0)
    assert 1 / len(scene.split.train) <= found.mean_inverse_visibility < 1.2 / len(scene.split.train)
    for view in scene.train_views[1:]:  # a wall in front of all but one
        write_depth(depth_path(view), np.full((view.camera.height, view.camera.width), 0.5))
    assert survey(scene, 0).mean_inverse_visibility == pytest.approx(1, abs=1e-6)


def test_a_scene_that_drops_harm_more_gets_fewer_of_them(statistics):
    dear = replace(statistics, drops_cost=3.0)
    assert drops_harm(0.1, dear) == pytest.approx(3 * drops_harm(0.1, statistics))
    usual, fewer = (draw("raindrop", 0, s) for s in (statistics, dear))
    assert fewer.coverage < usual.coverage or fewer.mist < usual.mist


def test_a_photograph_alone_is_one_moment_of_the_rain(statistics):
    alone = replace(statistics, views=statistics.views[:1])
    assert [draw("raindrop", 1, one).key_frames for one in (statistics, alone)] == [3, 1]


@pytest.mark.parametrize("grade", [0, 1, 2])
def test_a_blurred_scene_costs_at_most_half_of_what_its_grade_says(statistics, grade):
    drawn = SharpRaindropEffect().draw(Pattern("raindrop", grade), statistics)
    open_, fixed = draw("raindrop", grade, statistics), severity.wanted_harm(LOSSES["raindrop"][grade], statistics)
    blurred = blur_harm(statistics)
    assert blurred(drawn.focus_blur) <= 0.501 * fixed
    assert drawn.focus_blur <= open_.focus_blur
    assert drawn.focus_blur > 0.99 * open_.focus_blur or blurred(open_.focus_blur) > 0.5 * fixed
    assert drawn.mist <= open_.mist


def test_the_harm_of_blur_is_what_it_changes_less_the_detail_that_is_lost_anyway(statistics):
    views = statistics.views[::2][:4]
    few = replace(statistics, views=views, clean_error=0.5)
    side = np.sqrt(views[0].camera.width * views[0].camera.height)
    expected = []
    for view in views:
        clean = view.image()
        seen = to_srgb(defocus(to_linear(clean), 9.0))
        fine = [np.mean((p - cv2.GaussianBlur(p, (0, 0), 1.0)) ** 2) for p in (seen, clean)]
        expected.append(np.mean((seen - clean) ** 2) + 0.5 * (fine[0] - fine[1]))
    assert blur_harm(few)(9.0 / side) == pytest.approx(np.mean(expected), rel=1e-4)
    assert blur_harm(few)(0.0) == 0
