from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy import integrate
from synthetic import ring_camera

from hydroviews.errors import InputError
from hydroviews.rain.scene_statistics import Light
from hydroviews.rain.storm import drop_sizes as storm_drops
from hydroviews.rain.storm import reference as storm_reference
from hydroviews.rain.storm.drop_sizes import Cloud, draw_cloud
from hydroviews.rain.storm.rasterise import NEAREST, Shutter, draw, project
from hydroviews.rain.storm.storm import Storm, StormPattern, draw_pattern, skylight, storm_light
from hydroviews.rain.storm.world import in_metres, metres_and_focus, up_direction
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import to_linear, to_srgb
from hydroviews.scene.scenes import View, no_points
from hydroviews.scene.seeds import generator

UP = np.array([0, -1.0, 0])
STILL = np.zeros(3)
SHUTTER = Shutter(time=0, exposure=0.01, aperture=0.0, focus=4.0)
PATTERN = StormPattern(30.0, 1.0, 1.0, 40.0, 0.2, 0.01, 0.003, 1.0, 5)


def camera(width: int = 100, height: int = 75) -> Camera:
    """At the origin, looking along +z, y down."""
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, np.eye(4))


def far(view: Camera) -> np.ndarray:
    return np.full((view.height, view.width), np.inf, np.float32)


def one_drop(at: tuple, velocity: tuple = (0, 8.0, 0), diameter: float = 0.003) -> Cloud:
    """A world with a single drop; it repeats after 100 metres."""
    return Cloud(*(np.array([values], float) for values in (at, velocity, diameter, 100)))


def composite(layers, picture):
    """The rainy view in linear light."""
    through = ((1 - layers["M"]) * (1 - layers["V"]))[..., None]
    return through * to_linear(picture) + np.stack([layers[c] for c in "RGB"], axis=-1)


def test_sizes_and_speeds_are_those_of_the_literature():
    sizes = np.linspace(0.5, 6, 200_001)
    numbers = 8000 * np.exp(-4.1 * 10**-0.21 * sizes)  # Marshall and Palmer at 10 mm/h
    for order in (0, 2, 3):
        by_hand = integrate.simpson(sizes**order * numbers, x=sizes)
        assert storm_drops.moment(order, 10, 0.5, 6) == pytest.approx(by_hand, rel=1e-6)
    measured = [4.03, 6.49, 8.06, 8.83, 9.09]  # by Gunn and Kinzer, m/s
    assert storm_drops.fall_speed(np.arange(1.0, 6)) == pytest.approx(measured, rel=0.03)


def test_a_denser_storm_keeps_its_drops():
    thin, dense = (draw_cloud(30, density, STILL, 0.3, UP, 7) for density in (0.1, 0.13))
    assert len(dense) > len(thin)
    for name in ("positions", "velocities", "diameters", "periods"):
        assert np.array_equal(getattr(dense, name)[: len(thin)], getattr(thin, name))


def test_drawn_drops_and_veil_together_hide_what_all_drops_hide():
    view = camera(120, 90)
    cloud = draw_cloud(30, 6, STILL, 0.3, UP, 1)
    covers = [draw(project(cloud, view, replace(SHUTTER, time=t)), far(view)) for t in (0.0, 0.7, 1.9)]
    drawn = float(np.mean(-np.log1p(-np.stack(covers))))
    everywhere = 6 * storm_drops.moment(2, 30, 0, 100) * np.pi / 4 * 1e-6  # m^2 a cubic metre
    veil = float(storm_drops.optical_depth(30, 6, np.array(30.0)))  # up to 30 metres
    assert veil > 0.5 * drawn > 0
    assert drawn + veil == pytest.approx(everywhere * 30, rel=0.03)


@pytest.mark.parametrize("velocity", [(0, 8, 0), (5, 5, 0), (-3, 8, 1), (8, 0, 0), (0, 0, 0.5), (0, 0, 0)])
@pytest.mark.parametrize("distance", [0.5, 3.0])
def test_a_drop_covers_its_own_area_however_it_moves(velocity, distance):
    view = camera(200, 150)
    cover = draw(project(one_drop((0.013, -0.021, distance), velocity), view, SHUTTER), far(view))
    area = np.pi / 4 * (0.003 * view.fx / (distance + velocity[2] * SHUTTER.exposure / 2)) ** 2
    assert cover.sum() == pytest.approx(area, rel=0.03)


def test_drawing_against_drops_followed_through_the_exposure():
    view = camera()
    cloud = draw_cloud(30, 0.15, np.array([2.0, 0, 0]), 0.3, np.array([0, -0.8, 0.6]), 3)
    depth = far(view)
    depth[:, 50:] = 2.0
    for shutter in (Shutter(2.0, 0.01, 0.004, 4.0), Shutter(2.0, 0.002, 0.0, 4.0)):
        fast = draw(project(cloud, view, shutter), depth)
        slow = storm_reference.cover(cloud, view, shutter, depth, samples=2**12)
        assert slow.max() > 0.01
        assert fast.mean() == pytest.approx(slow.mean(), rel=0.02)
        assert np.sqrt(np.mean((fast - slow) ** 2)) < 0.3 * np.sqrt(np.mean(slow**2))
        wide = [cv2.GaussianBlur(np.asarray(c, np.float64), (0, 0), 2) for c in (fast, slow)]
        assert np.abs(wide[0] - wide[1]).max() < 0.08 * wide[1].max()


def test_drops_move_between_views_unless_the_storm_is_frozen(yard):
    view = yard.views[3]
    clean = view.image()
    falling, frozen = (Storm(replace(PATTERN, interval=i), yard).layers(clean, view)["M"] for i in (0.2, 0.0))
    assert not np.array_equal(falling, frozen)
    later = Storm(replace(PATTERN, interval=0.5), yard)
    shifted = replace(later.cloud, positions=later.cloud.positions + later.cloud.velocities * 3 * 0.5)
    shutter = Shutter(0.0, PATTERN.exposure, PATTERN.aperture, later.parameters["focus"])
    expected = draw(project(shifted, view.camera, shutter), far(view.camera))
    assert np.allclose(later.drops(view, in_metres(view.camera, 1.0), far(view.camera)), expected, atol=1e-5)


def test_surfaces_hide_what_is_behind_them():
    view = camera()
    streaks = project(draw_cloud(80, 1, STILL, 0.3, UP, 4), view, SHUTTER)
    wall = np.full((75, 100), 1.0, np.float32)
    wall[:, 60:] = np.inf
    cover, open_air = draw(streaks, wall), draw(streaks, far(view))
    assert np.array_equal(cover[:, 60:], open_air[:, 60:])
    assert np.array_equal(cover[:, :60], draw(streaks[streaks[:, 7] < 1], far(view))[:, :60])
    assert cover[:, :60].sum() < 0.9 * open_air[:, :60].sum()
    assert draw(streaks, np.full((75, 100), NEAREST, np.float32)).max() == 0


@pytest.mark.parametrize("speed", [-20.0, 20.0])
def test_a_drop_that_passes_the_lens_is_drawn_while_it_is_in_front(speed):
    view = camera()
    half = NEAREST - 0.5 * speed * SHUTTER.exposure  # crosses the nearest depth half way through the exposure
    streaks = project(one_drop((0.02, 0.0, half), (0, 0, speed)), view, SHUTTER)
    assert len(streaks) == 1
    assert np.isfinite(streaks).all()
    farthest = NEAREST + 0.5 * abs(speed) * SHUTTER.exposure
    assert streaks[0, 4] == pytest.approx(view.fx * 0.02 * (1 / NEAREST - 1 / farthest))
    assert streaks[0, 6] == pytest.approx(0.5 * np.pi / 4 * (0.003 * view.fx / ((NEAREST + farthest) / 2)) ** 2)
    assert len(project(one_drop((0.02, 0, -1.0), (0, 0, 1.0)), view, SHUTTER)) == 0


@pytest.mark.parametrize("wind", [0.0, 4.0, -7.0])
def test_streaks_lean_with_the_wind(wind):
    view = camera(400, 300)
    streaks = project(draw_cloud(30, 4, np.array([wind, 0, 0]), 0.0, UP, 6), view, SHUTTER)
    middle = np.abs(streaks[:, :2] - (200, 150)).max(axis=1) < 40
    diameters = np.sqrt(streaks[middle, 6] * 4 / np.pi) * streaks[middle, 7] / view.fx * 1000
    expected = np.arctan2(storm_drops.fall_speed(diameters), wind)
    assert np.allclose(np.arctan2(streaks[middle, 3], streaks[middle, 2]), expected, atol=1e-6)


def test_up_is_told_from_level_cameras():
    def up(*cameras):
        return up_direction([View(str(i), camera, None) for i, camera in enumerate(cameras)])

    assert np.allclose(up(*(ring_camera(i, 48, 36) for i in range(9))), [0, -1, 0], atol=3e-3)
    tilt = np.eye(4)  # all look the same way, down
    tilt[:3, :3] = cv2.Rodrigues(np.array([0.5, 0, 0]))[0]
    assert np.allclose(up(replace(camera(), world_to_camera=tilt)), -tilt[1, :3], atol=1e-9)
    on_its_head = replace(camera(), world_to_camera=np.diag([-1.0, -1, 1, 1]))
    with pytest.raises(InputError, match="which way is up"):
        up(camera(), on_its_head)


def test_scale_is_estimated_from_what_cameras_look_at(statistics):
    scale, focus = metres_and_focus(statistics.views, statistics.points)
    assert scale == pytest.approx(1.0, rel=0.1)  # the ring stands 4 units away
    assert focus == 4
    assert metres_and_focus(statistics.views, statistics.points, 3.0) == (3.0, pytest.approx(3.0 * 4, rel=0.1))
    assert metres_and_focus(statistics.views, no_points(), 3.0) == (3.0, 4.0)
    with pytest.raises(InputError, match="how large the scene is"):
        Storm(PATTERN, replace(statistics, points=no_points()))


@pytest.mark.parametrize("impossible", [0.0, -1.0, float("nan")])
def test_an_impossible_scale_is_refused(statistics, impossible):
    with pytest.raises(InputError, match="scale of a capture"):
        Storm(PATTERN, replace(statistics, metres_per_unit=impossible))


def test_the_same_storm_in_other_units(yard):
    small = tuple(replace(v, camera=in_metres(v.camera, 0.1)) for v in yard.views)
    points = replace(yard.points, positions=yard.points.positions * 0.1)
    other = replace(yard, views=small, points=points, metres_per_unit=10.0)
    planes, same = (Storm(PATTERN, s).layers(yard.views[2].image(), s.views[2]) for s in (yard, other))
    for name, plane in planes.items():
        assert np.allclose(plane, same[name], atol=1e-5), name


def test_layers_are_a_composite_in_linear_light(statistics):
    view = statistics.views[0]
    layers = Storm(replace(PATTERN, density=8.0), statistics).layers(view.image(), view)
    assert 0 < layers["M"].mean() < 0.5
    assert 0 < layers["V"].max() <= 0.6
    assert composite(layers, view.image()).max() <= 1.0
    flat = np.full((36, 48, 3), 0.5, np.float32)  # rain over an even grey world shows that grey
    grey = replace(statistics, light=Light((0.2, 0.2, 0.2), (0.2, 0.2, 0.2)))
    layers = Storm(replace(PATTERN, density=8.0), grey).layers(flat, view)
    assert np.allclose(to_srgb(composite(layers, flat)), flat, atol=1e-3)


def test_streaks_shine_near_lamps_and_vanish_in_the_dark(statistics):
    view = replace(statistics.views[0], camera=statistics.views[0].camera.resized(160, 120))
    night = np.full((120, 160, 3), 0.01, np.float32)
    night[20:26, 20:26] = 1.0
    dark = replace(statistics, light=Light((0.003, 0.003, 0.003), (0.02, 0.02, 0.02)))
    layers = Storm(replace(PATTERN, density=8.0), dark).layers(night, view)
    light = layers["G"] / (1 - (1 - layers["M"]) * (1 - layers["V"]))
    assert light[10:36, 10:36].mean() > 20 * light[90:, 130:].mean()
    assert layers["G"][90:, 130:].max() < 1 / 255 / 12.92  # half of the darkest grey that 8 bits have


def test_rain_is_as_bright_as_the_sky_that_pictures_do_not_show():
    assert skylight(Light((0.1, 0.1, 0.1), (0.4, 0.4, 0.4))) == pytest.approx(2)
    assert skylight(Light((0.1, 0.2, 0.3), (0.1, 0.2, 0.3))) == pytest.approx(1)
    assert skylight(Light((0, 0, 0), (0, 0, 0))) == 1
    light = Light((0.1, 0.1, 0.1), (0.4, 0.4, 0.4))
    for shown, expected in ((0.05, 0.1), (0.3, 0.4), (0.7, 0.7)):  # lifted; as bright as the air; brighter already
        grey = to_srgb(np.full((20, 30, 3), shown, np.float32))
        assert np.allclose(storm_light(grey, light), expected, rtol=1e-3)


def test_the_veil_grows_with_distance_and_is_mixed_at_edges(yard):
    storm = Storm(replace(PATTERN, density=20.0), yard)
    view = camera(80, 60)
    clean, depth = np.full((60, 80, 3), 0.2, np.float32), np.full((60, 80), 5.0, np.float32)
    depth[:, 40:], clean[:, 41:] = np.inf, 0.8
    clean[:, 40] = 0.5  # half of it is the far side
    veil = storm.veil(view, depth, clean)
    near, sky = veil[:, 30].mean(), veil[:, 70].mean()
    assert 0 < near < 0.2 * sky
    assert sky == pytest.approx(0.6, abs=1e-3)
    assert near + 0.2 * (sky - near) < veil[:, 40].mean() < near + 0.8 * (sky - near)
    assert np.all(storm.veil(view, 2 * depth, clean)[:, :36] > veil[:, :36])


def test_patterns_are_graded_and_seeded():
    storms = [[draw_pattern(generator(seed, "storm", grade), grade) for seed in range(50)] for grade in range(3)]
    light, medium, heavy = ([storm.rate for storm in grade] for grade in storms)
    assert max(light) < min(medium) <= max(medium) < min(heavy)
    assert all(1 / 200 <= storm.exposure <= 1 / 60 for grade in storms for storm in grade)
    assert draw_pattern(generator(0, "storm", 1), 1) == storms[1][0]
