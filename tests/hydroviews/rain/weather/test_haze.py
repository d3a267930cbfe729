import json
from dataclasses import replace

import numpy as np
import pytest
from rained import rained

from hydroviews.errors import InputError
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.weather import reference
from hydroviews.rain.weather.haze import DEEPEST, RANGE, Haze, HazePattern
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import to_uint8
from hydroviews.scene.scenes import View, no_points

PATTERN = Pattern("haze", 1)
GREY_AIR = (0.9, 0.9, 0.9)


def in_haze(extinction, view, statistics, picture, air=GREY_AIR):
    return rained(Haze(), HazePattern(extinction, air), PATTERN, statistics, view, picture)


def cover(extinction: float, view: View, statistics: SceneStatistics) -> np.ndarray:
    picture = np.full((view.camera.height, view.camera.width, 3), 0.2, np.float32)
    return in_haze(extinction, view, statistics, picture).layers["H"]


def write_map(view: View, depth) -> None:
    write_depth(depth_path(view), np.broadcast_to(np.float32(depth), (view.camera.height, view.camera.width)))


def test_cover_follows_the_distance_along_the_ray(yard, ahead):
    write_map(ahead, 3.0)
    camera = ahead.camera
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    far = 3.0 * np.sqrt(1 + ((x - camera.cx) / camera.fx) ** 2 + ((y - camera.cy) / camera.fy) ** 2)
    expected = 1 - np.exp(-0.2 * far)
    inner = (slice(3, -3), slice(3, -3))  # the filter that mixes edges reaches over the border
    assert np.abs(cover(0.2, ahead, yard) - expected)[inner].max() < 0.002
    halved = cover(0.2, ahead, replace(yard, metres_per_unit=0.5))
    assert np.abs(halved - (1 - np.exp(-0.1 * far)))[inner].max() < 0.002


def test_the_composite_is_koschmieders_law(yard):
    clean, air = yard.samples[0], (0.9, 0.95, 1.0)
    rainy, layers, parameters = in_haze(0.1, yard.sampled_views[0], yard, clean, air)
    assert np.abs(rainy - reference.hazy(clean, layers["H"], parameters["airlight"])).max() < 1e-6
    assert parameters["airlight"] == pytest.approx(np.array(yard.light.air) * air, abs=1e-6)


def test_without_extinction_the_view_stays_to_the_byte(yard, ahead):
    for depth in (2.0, np.inf):
        write_map(ahead, depth)
        picture = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32)
        assert np.array_equal(to_uint8(in_haze(0.0, ahead, yard, picture).picture), to_uint8(picture))
    parameters = Haze().place(HazePattern(0.0, GREY_AIR), PATTERN, yard).parameters
    assert "visibility" not in parameters
    assert "inf" not in json.dumps(parameters, allow_nan=False)


@pytest.mark.parametrize("nothing", [np.inf, np.nan, 0.0, -1.0, 1e10])
def test_what_has_no_depth_is_sky_behind_a_layer_of_haze(yard, ahead, nothing):
    depth = np.full((30, 40), 2.0, np.float32)
    depth[:, 20:] = nothing
    write_map(ahead, depth)
    found = cover(0.01, ahead, yard)
    assert np.isfinite(found).all()
    assert found[:, 30:] == pytest.approx(1 - np.exp(-0.01 * DEEPEST), abs=1e-3)
    assert found[:, :10].max() < 0.03
    assert np.allclose(cover(10.0, ahead, yard)[:, 30:], 1)


def test_neither_depth_nor_points(yard, ahead):
    blind = replace(yard, points=no_points())
    with pytest.raises(InputError, match=r"(?s)how far away things are cannot be told.*0 points.*add depth maps"):
        Haze().draw(PATTERN, blind)
    with pytest.raises(InputError, match="ahead: how far away"):
        away = replace(ahead, camera=replace(ahead.camera, world_to_camera=np.diag([1.0, 1, 1, 1])))
        behind = replace(yard, points=replace(yard.points, positions=yard.points.positions - (0, 0, 50)))
        cover(0.1, away, behind)
    with pytest.raises(InputError, match=r"how large the scene is[\s\S]*capture\.json"):
        Haze().draw(PATTERN, replace(blind, metres_per_unit=None))


def test_an_unknown_scale_is_estimated_and_said_to_be(yard):
    scenes = yard, replace(yard, metres_per_unit=None)
    known, unknown = (Haze().place(HazePattern(0.1, GREY_AIR), PATTERN, scene).parameters for scene in scenes)
    assert (known["metres_per_unit"], known["metres_estimated"]) == (1.0, False)
    assert unknown["metres_per_unit"] == pytest.approx(1.0, rel=0.1)
    assert unknown["metres_estimated"]
    assert known["visibility"] == pytest.approx(RANGE / 0.1)
