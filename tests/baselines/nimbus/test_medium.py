"""The medium against closed forms in float64."""

import math

import numpy as np
import pytest
import torch
from splats import camera

from baselines.nimbus.config import MediumConfig
from baselines.nimbus.medium import Medium, through
from baselines.nimbus.view_rays import Box, Rays, box_around, rays_of

UNIT = 2.0
BOX = Box(np.array([0.5, -1.0, 2.0]), np.array([3.0, 4.0, 5.0]), UNIT)


def medium(extinction=None, samples=32, cells=6, box=BOX):
    """In float64; of the same extinction everywhere, per unit."""
    made = Medium(MediumConfig(cells=cells), box, 0, samples).double()
    if extinction is not None:
        with torch.no_grad():
            made.field.fill_(0.3)
            made.log_scale.fill_(math.log(extinction / math.log1p(math.exp(0.3))))
    return made


def rays(distances, directions, start=(0.0, 0.0, 0.0), box=BOX):
    """From a point in the world, of unit directions."""
    directions = np.asarray(directions, float) / np.linalg.norm(directions, axis=1, keepdims=True)
    arrays = (np.asarray(start) - box.middle) / box.reach, directions / box.reach, np.asarray(distances, float)
    return Rays(*(torch.from_numpy(values) for values in arrays))


def test_a_uniform_medium_dims_exponentially_and_adds_the_rest_as_airlight():
    made, distances = medium(0.7), np.array([0.1, 1.0, 2.5])
    shown = made.transmission(rays(distances, np.random.default_rng(0).normal(size=(3, 3))))
    expected = np.exp(-0.7 * distances / UNIT)
    assert np.allclose(shown.detach(), expected, rtol=0, atol=1e-12)
    seen = through(torch.zeros(1, 3, 3, dtype=torch.float64), shown[None], made.airlight)
    assert np.allclose(seen.detach()[0], made.airlight.detach() * (1 - expected[:, None]), atol=1e-12)
    assert np.allclose(made.airlight.detach(), 0.5)


def test_reads_are_trilinear():
    made, rng = medium(samples=1), np.random.default_rng(1)
    grid = torch.from_numpy(rng.random((6, 6, 6)))
    inside = BOX.middle + BOX.reach * rng.uniform(-0.9, 0.9, (40, 3))
    ways = inside - BOX.middle
    distances = np.linalg.norm(ways, axis=1)
    cast = rays(2 * distances, ways, BOX.middle)  # whose middle is the place, if they do not leave the box before
    first, length = cast.inside()
    assert not first.any()
    found = -np.log(made.transmission(cast, grid)) * UNIT / length
    places = (length / 2)[:, None].numpy() / distances[:, None] * ways / BOX.reach
    assert np.allclose(found, [trilinear(grid.numpy(), place) for place in places], atol=1e-12)


def trilinear(grid, place):
    """The value at (x, y, z) in [-1, 1] of a grid by z, y and x whose corners are the box's."""
    at = (np.asarray(place)[::-1] + 1) / 2 * (np.array(grid.shape) - 1)
    low = np.minimum(at.astype(int), np.array(grid.shape) - 2)
    value = 0.0
    for corner in np.ndindex(2, 2, 2):
        weights = [share if up else 1 - share for up, share in zip(corner, at - low, strict=True)]
        value += np.prod(weights) * grid[tuple(low + corner)]
    return value


def test_along_a_ramp_the_integral_is_exact():
    made = medium(samples=5)
    ramp = torch.linspace(1, 3, 6, dtype=torch.float64).expand(6, 6, 6).contiguous()  # along x
    shown = made.transmission(rays([2.0], [[1, 0, 0]], BOX.middle), ramp)  # x from 0 to 2/3 of the reach
    assert float(shown) == pytest.approx(math.exp(-(2 + 1 / 3) * 2.0 / UNIT), abs=1e-12)


@pytest.mark.parametrize(
    ("distance", "expected"), [(0.0, 1.0), (math.inf, math.exp(-0.7 * 3 / UNIT)), (1e30, math.exp(-0.7 * 3 / UNIT))]
)
def test_a_ray_ends_where_the_scene_is_or_where_the_box_ends(distance, expected):
    shown = medium(0.7).transmission(rays([distance], [[1, 0, 0]], BOX.middle))
    assert float(shown.detach()) == pytest.approx(expected, abs=1e-9)


def test_outside_of_the_box_air_is_clear():
    made, ahead = medium(0.7), [[1.0, 0.0, 0.0]]
    before = BOX.middle - np.array([10.0, 0, 0])
    assert float(made.transmission(rays([6.9], ahead, before)).detach()) == 1  # ends before it
    entered = made.transmission(rays([8.0], ahead, before))  # a unit of it inside
    assert float(entered.detach()) == pytest.approx(math.exp(-0.7 / UNIT), abs=1e-9)
    for missing in (BOX.middle - np.array([10.0, 9.0, 0]), BOX.middle + np.array([10.0, 0, 0])):
        assert float(made.transmission(rays([math.inf], ahead, missing)).detach()) == 1


@pytest.mark.parametrize(("scale", "expected"), [(-1e9, 1.0), (1e9, 0.0)])
def test_an_empty_and_a_saturated_medium_stay_finite(scale, expected):
    made = medium().float()
    with torch.no_grad():
        made.log_scale.fill_(scale)
        made.field.fill_(30.0)
    cast = rays_of(camera(8, 6), np.full((6, 8), np.inf, np.float32), Box(np.zeros(3), np.full(3, 6.0), UNIT))
    shown = made.transmission(cast)
    assert (shown == expected).all()
    through(torch.full((6, 8, 3), 0.4), shown.reshape(6, 8), made.airlight).sum().backward()
    assert all(torch.isfinite(parameter.grad).all() for parameter in made.parameters())


def test_rays_go_through_the_middles_of_pixels():
    view, box = camera(8, 6), Box(np.array([0.2, 0, 0]), np.array([2.0, 3, 4]), 1.0)
    depth = np.random.default_rng(0).uniform(1, 5, (6, 8)).astype(np.float32)
    cast = rays_of(view, depth, box)
    points = (cast.origin + cast.distances[:, None] * cast.directions).numpy() * box.reach + box.middle
    pixels, depths = view.project(points)
    assert np.allclose(pixels, [(x + 0.5, y + 0.5) for y in range(6) for x in range(8)], atol=1e-3)
    assert np.allclose(depths, depth.ravel(), rtol=1e-5)
    nothing = rays_of(view, np.full((6, 8), np.nan, np.float32), box)
    assert torch.isinf(nothing.distances).all()


def test_the_box_holds_nearly_all_points_twice():
    rng, cameras = np.random.default_rng(0), [camera(8, 6, angle) for angle in range(4)]
    points = np.concatenate([rng.uniform(-1, 1, (5000, 3)), [[1e4, 0, 0], [np.nan, 0, 0]]])
    box = box_around(points, cameras, 2.0)
    assert np.allclose(box.middle, 0, atol=0.05)
    assert np.allclose(box.reach, 2 * 0.98, atol=0.05)
    assert box.unit == pytest.approx(4, rel=0.1)
    alone = box_around(np.zeros((0, 3)), cameras, 2.0)
    assert np.isfinite([*alone.middle, *alone.reach, alone.unit]).all()
    assert (box_around(np.ones((1, 3)), cameras[:1], 2.0).reach > 0).all()
