import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hydroviews.rain.other_make.rainfall import MOST, draw_pattern, draw_rainfall, fall_direction, rain_over
from hydroviews.rain.other_make.severity import rainfall_harm
from hydroviews.rain.other_make.streak import OtherStreaks, Rainfall, fall_in
from hydroviews.rain.other_make.strokes import FINEST, draw_strokes
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.streaks.measures import streak_angle
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator

PATTERN = replace(draw_pattern(generator(1, "rain")), strokes=2000.0, veil=0.1)
STILL = replace(PATTERN, lean=0.0, swirl=0.0, bend=0.0)
DOWN, AHEAD = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])


def camera(width, height, pose):
    focal = 1.2 * max(width, height)
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)


def turned(axis, degrees):
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.radians(degrees) * np.asarray(axis, np.float64))[0]
    return pose


def exact(stroke, width, height):
    """One stroke in float64, every pixel of the picture by the formula."""
    x, y, to_x, to_y, bend, sigma, alpha = stroke
    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    run = np.array([to_x - x, to_y - y])
    length = np.hypot(*run)
    s = ((columns - x) * run[0] + (rows - y) * run[1]) / length**2
    bow = np.where((s > 0) & (s < 1), 4 * s * (1 - s), 0)
    off = ((columns - x) * run[1] - (rows - y) * run[0]) / length - bend * bow
    wide = math.hypot(sigma, FINEST)
    return alpha * sigma / wide * bow * np.exp(-0.5 * (off / (wide * (0.6 + 0.4 * bow))) ** 2)


@pytest.mark.parametrize("ends", [(20, 5, 30, 70), (5, 20, 70, 33), (60, 70, 20, 30), (-10, 10, 30, 50)])
@pytest.mark.parametrize("bend", [0.0, 2.5, -2.5])
def test_a_stroke_is_the_formula(ends, bend):
    stroke = (*ends, bend, 1.2, 0.7)
    ours = draw_strokes(np.array([stroke]), 80, 80)
    np.testing.assert_allclose(ours, exact(stroke, 80, 80), atol=0.7 * math.exp(-4.5))  # drawn to 3 deviations


@pytest.mark.parametrize("roll", [-30, 0, 20, 90])
def test_rain_falls_down_however_the_camera_is_held(roll):
    view = camera(320, 240, turned(AHEAD, roll))
    layer = draw_rainfall(STILL, view, view.rotation @ fall_direction(STILL, DOWN, AHEAD), generator(0))
    off = (streak_angle(layer) - (90 - roll) + 90) % 180 - 90
    assert abs(off) < 2


def test_rain_seen_from_below_flies_apart_from_a_vanishing_point():
    """A camera that looks up sees streaks that run away from its middle."""
    view = camera(200, 200, turned((1, 0, 0), -90))
    towards = view.rotation @ DOWN
    assert abs(towards[2]) > 0.99
    layer = draw_rainfall(replace(STILL, strokes=600.0, length=0.4), view, towards, generator(0))
    left, top = layer[60:140, :70], layer[:70, 60:140]
    assert abs((streak_angle(left) + 90) % 180 - 90) < 20
    assert abs(streak_angle(top) - 90) < 20


def test_every_view_has_other_streaks_and_the_same_again(statistics):
    rain, views = Rainfall(PATTERN, Pattern("streak-b", 0), statistics), statistics.views
    layers = [rain.layers(view.image(), view)["A"].tobytes() for view in (*views, views[3])]
    assert len(set(layers)) == len(views)
    assert layers[3] == layers[-1]


def test_cameras_that_do_not_tell_up_see_rain_fall_down_their_pictures(statistics, caplog):
    """A picture on its head beside an upright one: parameters and a warning say that down is not known."""
    poses, view = (np.eye(4), turned(AHEAD, 180)), statistics.views[0]
    views = tuple(replace(view, camera=replace(view.camera, world_to_camera=pose)) for pose in poses)
    rain = Rainfall(STILL, Pattern("streak-b", 0), replace(statistics, views=views))
    assert rain.parameters["down"] is None
    assert "rain falls down the pictures" in caplog.text
    assert all(fall_in(STILL, view.camera, views[0].camera, None)[1] == 1 for view in views)


@pytest.mark.parametrize("screen", [False, True])
def test_the_composite_is_its_formula_under_a_coloured_sky(screen):
    rng = np.random.default_rng(0)
    clean = rng.random((6, 8, 3), np.float32)
    a, h = rng.random((2, 6, 8), np.float32)
    sky = np.array([0.6, 0.7, 0.8], np.float32)
    b, c, streaks, veil = (one.astype(np.float64) for one in (clean, sky, a[..., None], h[..., None]))
    veiled = (1 - veil) * b + veil * c
    expected = 1 - (1 - veiled) * (1 - streaks * c) if screen else (1 - streaks) * veiled + streaks * c
    np.testing.assert_allclose(rain_over(clean, a, h, screen, sky), expected, rtol=0, atol=1e-6)


def test_grades_are_harder_in_order_and_within_reach(statistics):
    drawn = [OtherStreaks().draw(Pattern("streak-b", level), statistics) for level in range(3)]
    harms = [rainfall_harm(pattern, statistics, [DOWN] * len(statistics.samples)) for pattern in drawn]
    assert harms == sorted(harms)
    assert all(0 < pattern.strokes <= MOST for pattern in drawn)
