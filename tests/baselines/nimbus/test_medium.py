"""NimbusGS: the medium against closed forms in float64, residuals that are no part of the scene, losses."""

import logging
import math

import numpy as np
import pytest
import torch
from scipy.interpolate import RegularGridInterpolator
from splats import camera

from baselines.nimbus.config import MediumConfig, ResidualConfig
from baselines.nimbus.losses import dark_channel, dark_loss, total_variation
from baselines.nimbus.medium import Medium, through
from baselines.nimbus.residual import Residuals, beyond
from baselines.nimbus.view_rays import Box, Rays, box_around, rays_of

UNIT = 2.0
BOX = Box(np.array([0.5, -1.0, 2.0]), np.array([3.0, 4.0, 5.0]), UNIT)


def medium(extinction=None, samples=32):
    """In float64; of the same extinction everywhere, per unit."""
    made = Medium(MediumConfig(cells=6), BOX, 0, samples).double()
    if extinction is not None:
        with torch.no_grad():
            made.field.fill_(0.3)
            made.log_scale.fill_(math.log(extinction / math.log1p(math.exp(0.3))))
    return made


def rays(distances, directions, start=(0.0, 0.0, 0.0)):
    """From a point in the world, of unit directions."""
    directions = np.asarray(directions, float) / np.linalg.norm(directions, axis=1, keepdims=True)
    arrays = (np.asarray(start) - BOX.middle) / BOX.reach, directions / BOX.reach, np.asarray(distances, float)
    return Rays(*(torch.from_numpy(values) for values in arrays))


def straight(made, distance, start=BOX.middle, grid=None):
    """The share that is left of light that goes along x."""
    return float(made.transmission(rays([distance], [[1.0, 0, 0]], start), grid).detach())


def test_a_uniform_medium_dims_exponentially_and_adds_the_rest_as_airlight():
    made, distances = medium(0.7), np.array([0.1, 1.0, 2.5])
    shown = made.transmission(rays(distances, np.random.default_rng(0).normal(size=(3, 3)))).detach()
    expected, airlight = np.exp(-0.7 * distances / UNIT), made.airlight.detach()
    assert np.allclose(airlight, 0.5)
    assert np.allclose(shown, expected, rtol=0, atol=1e-12)
    seen = through(torch.zeros(1, 3, 3, dtype=torch.float64), shown[None], airlight)
    assert np.allclose(seen[0], airlight * (1 - expected[:, None]), atol=1e-12)


def test_reads_are_trilinear():
    made, rng = medium(samples=1), np.random.default_rng(1)
    grid = torch.from_numpy(rng.random((6, 6, 6)))
    ways = BOX.reach * rng.uniform(-0.9, 0.9, (40, 3))
    distances = np.linalg.norm(ways, axis=1)
    cast = rays(2 * distances, ways, BOX.middle)  # whose middle is the place, if they do not leave the box before
    first, length = cast.inside()
    assert not first.any()
    found = -np.log(made.transmission(cast, grid)) * UNIT / length
    places = (length / 2)[:, None].numpy() / distances[:, None] * ways / BOX.reach
    # The grid is by z, y and x, and its corners are the box's.
    expected = RegularGridInterpolator([np.linspace(-1, 1, 6)] * 3, grid.numpy())(places[:, ::-1])
    assert np.allclose(found, expected, atol=1e-12)


def test_along_a_ramp_the_integral_is_exact():
    ramp = torch.linspace(1, 3, 6, dtype=torch.float64).expand(6, 6, 6).contiguous()  # along x
    shown = straight(medium(samples=5), 2.0, grid=ramp)  # x from 0 to 2/3 of the reach
    assert shown == pytest.approx(math.exp(-(2 + 1 / 3) * 2.0 / UNIT), abs=1e-12)


BEFORE = BOX.middle - np.array([10.0, 0, 0])


@pytest.mark.parametrize(
    ("start", "distance", "length"),
    [
        pytest.param(BOX.middle, 0.0, 0, id="no way"),
        pytest.param(BOX.middle, math.inf, 3, id="to the end of the box"),
        pytest.param(BOX.middle, 1e30, 3, id="very far"),
        pytest.param(BEFORE, 6.9, 0, id="ends before the box"),
        pytest.param(BEFORE, 8.0, 1, id="ends a unit inside"),
        pytest.param(BEFORE - np.array([0, 9.0, 0]), math.inf, 0, id="misses the box"),
        pytest.param(BOX.middle + np.array([10.0, 0, 0]), math.inf, 0, id="leaves the box behind"),
    ],
)
def test_light_is_dimmed_from_where_a_ray_enters_the_box_to_where_it_ends(start, distance, length):
    expected = 1 if length == 0 else pytest.approx(math.exp(-0.7 * length / UNIT), abs=1e-9)
    assert straight(medium(0.7), distance, start) == expected


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


RESIDUAL = ResidualConfig(threshold=0.1, first=0.2, every=0.1)
GREY = np.full((4, 6, 3), 0.5, np.float32)


def photograph(*places):
    """Grey but for some bright pixels."""
    picture = GREY.copy()
    for place in places:
        picture[place] = 0.9
    return picture


def test_it_begins_after_a_while_and_is_made_anew_when_due():
    residuals, bright = Residuals(RESIDUAL, 2, 100), photograph((0, 0))
    assert residuals.of(bright, GREY, 0, 19, None) is None
    assert residuals.share == 0
    first = residuals.of(bright, GREY, 0, 20, None)
    assert first.sum() == 1
    assert residuals.of(GREY, GREY, 0, 29, None) is first
    assert not residuals.of(GREY, GREY, 0, 30, None).any()
    assert residuals.of(bright[::2, ::2], GREY[::2, ::2], 0, 31, None).shape == (2, 3)  # another size
    assert residuals.share == pytest.approx(1 / 6)
    assert Residuals(None, 2, 100).of(GREY, GREY, 0, 99, None) is None


def test_a_pixel_is_the_residuals_if_it_is_off_by_more_than_the_threshold():
    picture = photograph((0, 1))
    picture[1, 2] = 0.2  # darker than expected
    picture[2, 3] = 0.59  # below the threshold
    picture[3, 4] = (0.8, 0.5, 0.5)  # a tenth in the mean is not beyond
    picture[3, 5] = (0.81, 0.5, 0.51)
    assert sorted(zip(*np.nonzero(beyond(picture, GREY, 0.1)), strict=True)) == [(0, 1), (3, 5)]
    hidden = np.zeros((4, 6), bool)
    hidden[0, 1] = True
    assert not beyond(picture, GREY, 0.1, hidden)[0, 1]


def test_a_residual_that_eats_everything_is_said_once(caplog):
    residuals = Residuals(RESIDUAL, 2, 100)
    with caplog.at_level(logging.WARNING):
        residuals.of(GREY + 0.4, GREY, 0, 20, None)
        assert not caplog.records  # the other view has not been seen
        for iteration in range(21, 90):
            residuals.of(GREY + 0.4, GREY, iteration % 2, iteration, None)
    (message,) = caplog.messages
    assert "residuals hold 100 %" in message


def test_the_dark_channel_is_the_least_value_of_each_patch():
    image = torch.full((4, 8, 3), 0.8, dtype=torch.float64)
    image[1, 2, 1] = 0.1
    image[3, 7, 0] = 0.3
    # Patches of 4 x 4 begin at columns 0, 2 and 4.
    assert dark_channel(image, 4).tolist() == [[0.1, 0.1, 0.3]]
    assert dark_loss(image, 0.5).item() == pytest.approx(0.5 / 3)
    assert dark_channel(image, 1).shape == (4, 8)
    assert dark_channel(image, 99).tolist() == [[0.1, 0.1, 0.3]]  # no patch is larger than the picture


def test_the_gradient_of_the_dark_channel_is_that_of_differences():
    image = torch.from_numpy(np.random.default_rng(0).random((6, 7, 3))).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: dark_loss(x, 3 / 7), image, atol=1e-8, rtol=1e-5)
    dark_loss(image, 3 / 7).backward()
    assert image.grad.sum().item() == pytest.approx(1)


def test_total_variation_counts_steps_between_neighbours():
    grid = torch.zeros(3, 3, 3, dtype=torch.float64)
    assert total_variation(grid).item() == 0
    grid[1, 1, 1] = 2.0  # two neighbours along each axis, of 18 pairs
    assert total_variation(grid).item() == pytest.approx(3 * 4 / 18)
    ramp = torch.arange(4, dtype=torch.float64).expand(4, 4, 4)
    assert total_variation(ramp).item() == pytest.approx(1)
