from dataclasses import replace

import numpy as np
import pytest
from rained import rained
from scipy import integrate

from hydroviews.errors import InputError
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import Light
from hydroviews.rain.weather import lamps
from hydroviews.rain.weather.dark import AmbientPattern
from hydroviews.rain.weather.night import Evening, Lamps, Night
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import to_linear, to_srgb
from hydroviews.scene.scenes import no_points

PATTERN = Pattern("night", 2)
GREY = np.full((30, 40, 3), 0.5, np.float32)
EVENING = Evening(
    ambient=AmbientPattern(3.0, 0.05, (1.0, 1.0, 1.0), 0.2),
    lamps=((0.3, -0.2, 2.0),),
    colour=(1.0, 1.0, 1.0),
    power=0.4,
    extinction=0.02,
)


def lit(evening, picture, view, statistics):
    """A view at night and its layers."""
    return rained(Lamps(), evening, PATTERN, statistics, view, picture)[:2]


def wall(view, metres: float):
    write_depth(depth_path(view), np.full((view.camera.height, view.camera.width), metres))


def test_lit_air_against_the_integral_along_the_ray(ahead):
    lamp, ways = np.array([0.3, -0.2, 2.0]), lamps.rays(ahead.camera)
    along, beside = lamps.along_and_beside(lamp, ahead.camera, ways)
    for at in ((0, 0), (11, 25), (15, 20), (29, 39)):
        assert np.linalg.norm(ways[at]) == pytest.approx(1)

        def light(t, way=ways[at]):
            return 1 / (np.sum((t * way - lamp) ** 2) + lamps.RADIUS**2)

        for far in (0.5, 2.0, 50.0):
            exact, _ = integrate.quad(light, 0, far, points=[min(along[at], far)], limit=200)
            depth = np.full(along.shape, far)
            assert lamps.air_glow(along, beside, depth)[at] == pytest.approx(exact, rel=1e-6)
            assert lamps.illumination(along, beside, depth)[at] == pytest.approx(light(far))


def test_a_lamp_has_its_place_in_the_world(yard, ahead):
    """Every camera sees it where it hangs, and the wall behind it is lit around that place."""
    beside = np.eye(4)
    beside[0, 3] = -0.5
    for view in (ahead, replace(ahead, camera=replace(ahead.camera, world_to_camera=beside))):
        wall(view, 2.5)
        _, layers = lit(EVENING, GREY, view, yard)
        at = view.camera.project(EVENING.lamps)[0][0, ::-1].astype(int)  # row and column
        glow, light = (np.unravel_index(layers[name].argmax(), (30, 40)) for name in "GE")
        assert glow == tuple(at)
        assert layers["G"].max() > 1  # the lamp itself
        assert np.abs(light - at).sum() <= 3


def test_what_is_nearer_hides_lamps(yard, ahead):
    glows = []
    for metres in (1.0, 1.9, 5.0):
        wall(ahead, metres)
        glows.append(lit(EVENING, GREY, ahead, yard)[1]["G"])
    assert glows[0].max() < glows[1].max() < 0.05 < 1 < glows[2].max()
    assert glows[0].mean() < glows[1].mean() < glows[2].mean()


def test_photographed_lamps_stay_bright_and_the_sky_does_not(yard, ahead):
    picture = np.full((30, 40, 3), 0.3, np.float32)
    picture[20, 10], picture[3, 5], picture[20, 30] = 1.0, 1.0, (1.0, 0.9, 0.3)  # a lamp, a cloud, a sunlit wall
    depth = np.full((30, 40), 3.0)
    depth[:10] = np.inf
    write_depth(depth_path(ahead), depth)
    night, layers = lit(replace(EVENING, lamps=()), picture, ahead, yard)
    assert night[20, 10].min() > 0.97
    assert night[3, 5].max() < 0.5
    assert night[20, 30].max() < 0.5
    assert not layers["E"].any()
    assert layers["G"][20, 11] > layers["G"][20, 16] > layers["G"][5, 38] >= 0  # its halo


def test_the_equation_of_the_night(yard, ahead):
    picture = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32)
    wall(ahead, 2.5)
    evening = replace(EVENING, colour=(1.2, 1.0, 0.5))
    night, layers = lit(evening, picture, ahead, yard)
    light = to_linear(picture).astype(np.float64)
    ambient, contrast = evening.ambient, 1 / 1.15
    dark = 0.5**ambient.stops * ambient.pivot * (light / ambient.pivot) ** contrast
    added = np.stack([layers[c] for c in "RGB"], axis=-1)
    expected = dark + layers["E"][..., None] * np.array(evening.colour) * light + added
    assert np.abs(night - to_srgb(expected)).max() < 1e-5


def test_scenes_without_points(yard, ahead):
    """Depth maps are enough for a night, which then has no lamps but those of the photographs."""
    blind = replace(yard, points=no_points())
    with pytest.raises(InputError, match="how far away things are"):
        Night().draw(PATTERN, blind)
    wall(ahead, 2.0)
    sample = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32)
    mapped = replace(blind, views=(ahead,), samples=(sample,), light=Light((0.3,) * 3, (0.8,) * 3))
    drawn = Night().draw(PATTERN, mapped)
    assert drawn["night"].lamps == ()
    assert "lamps: 0" in Night().describe(Night().place(drawn, PATTERN, mapped).parameters)
