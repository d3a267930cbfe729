"""From pixels to points, to six pictures of them, and back: against closed forms and torch's own sampler."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from by_hand import assert_same_values_and_gradients
from splats import camera, cloud, with_values
from torch.nn import functional

from baselines.wild_gs.lifting import lifted, rendered_depth
from baselines.wild_gs.triplane import VALUES, TriplaneNetwork, plane_pictures, read

SIDE = 8
RED, BLUE = torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 1.0])


def seen(points, colours, counted=None, side=SIDE):
    """The pictures as [plane, side they are seen from, 4, side, side]."""
    counted = torch.ones(len(points), dtype=torch.bool) if counted is None else counted
    return plane_pictures(points, colours, counted, side).unflatten(1, (2, VALUES))


def place(u, v):
    """Row and column of a place on a plane."""
    return int((v + 1) / 2 * SIDE), int((u + 1) / 2 * SIDE)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_of_two_points_each_side_of_a_plane_shows_the_nearer(axis):
    """Planes xy, yz, zx lie across z, x, y."""
    points = torch.tensor([[0.3, -0.6, 0.1]] * 2)
    points[:, axis] = torch.tensor([0.8, -0.8])
    picture = seen(points, torch.stack([RED, BLUE]))[(axis + 1) % 3]
    row, column = place(points[0, (axis + 1) % 3], points[0, (axis + 2) % 3])
    above, behind = picture[:, :, row, column]
    assert above.tolist() == [0.5, -0.5, -0.5, 1]
    assert behind.tolist() == [-0.5, -0.5, 0.5, 1]
    assert picture[:, 3].sum() == 2  # nothing else is on the plane


def test_points_close_together_are_averaged_and_those_beyond_are_hidden():
    points = torch.tensor([[0.1, 0.1, 0.5], [0.11, 0.12, 0.45], [0.1, 0.1, 0.0]])
    colours = torch.stack([RED, BLUE, torch.ones(3)])
    row, column = place(0.1, 0.1)
    above, behind = seen(points, colours)[0, :, :, row, column]
    assert torch.allclose(above, torch.tensor([0, -0.5, 0, 1.0]))
    assert torch.allclose(behind, torch.tensor([0.5, 0.5, 0.5, 1]))


def test_what_does_not_count_or_lies_beyond_the_box_is_not_shown():
    points = torch.tensor([[0.1, 0.1, 0.9], [0.1, 0.1, 1.2], [0.1, 0.1, -0.2]])
    pictures = seen(points, torch.stack([RED, RED, BLUE]), torch.tensor([False, True, True]))
    row, column = place(0.1, 0.1)
    assert torch.allclose(pictures[0, :, :, row, column], torch.tensor([[-0.5, -0.5, 0.5, 1]] * 2))
    assert pictures[:, :, 3].sum() == 6


@pytest.mark.parametrize("count", [0, 3])
def test_no_points_are_empty_pictures(count):
    pictures = seen(torch.zeros(count, 3), torch.ones(count, 3), torch.zeros(count, dtype=torch.bool))
    assert pictures.shape == (3, 2, VALUES, SIDE, SIDE)
    assert not pictures.any()
    planes = TriplaneNetwork((8, 16, 32), 5)(pictures.flatten(1, 2))
    assert planes.shape == (3, 5, SIDE, SIDE)
    assert planes.isfinite().all()


def test_reading_and_its_gradient_are_those_of_torchs_sampler():
    generator = torch.Generator().manual_seed(1)
    planes = torch.rand(3, 4, 6, 6, generator=generator, dtype=torch.float64)
    positions = 2.6 * torch.rand(40, 3, generator=generator, dtype=torch.float64) - 1.3
    upstream = torch.rand(40, 4, generator=generator, dtype=torch.float64)

    def theirs(planes, positions):
        pairs = torch.stack([positions[:, [0, 1]], positions[:, [1, 2]], positions[:, [2, 0]]])[:, :, None]
        values = functional.grid_sample(planes, pairs, padding_mode="border", align_corners=False)
        return values[..., 0].sum(dim=0).T

    assert_same_values_and_gradients(read, theirs, upstream, planes, positions)


def wall(depth, view, count=40, reach=3.0):
    """Opaque Gaussians close together on the plane at a depth before a camera, as tensors."""
    axis = np.linspace(-reach, reach, count)
    local = np.stack([*np.meshgrid(axis, axis), np.full((count, count), depth)], axis=-1).reshape(-1, 3)
    means = (local - view.world_to_camera[:3, 3]) @ view.rotation
    gaussians = replace(cloud(len(means), 0), means=means.astype(np.float32))
    for name, value in (("quaternions", [1, 0, 0, 0]), ("log_scales", np.log(0.1)), ("opacity_logits", 6), ("sh", 0)):
        gaussians = with_values(gaussians, name, slice(None), value)
    return {name: torch.from_numpy(value) for name, value in gaussians.state_dict().items()}


def test_pixels_of_a_plane_are_lifted_onto_it():
    view = camera(23, 17, 1.1)
    normal, offset = np.array([0.3, -0.8, 0.52]), 0.4  # n . p = offset, somewhere before the camera
    across, down = view.slopes
    rays = np.stack([*np.meshgrid(across, down), np.ones((17, 23))], axis=-1) @ view.rotation
    depths = (offset - normal @ view.centre) / (rays @ normal)
    expected = view.centre + rays * depths[..., None]
    points = lifted(torch.from_numpy(depths), view)
    assert np.allclose(points.numpy(), expected.reshape(-1, 3), atol=1e-12)
    assert np.allclose(points.numpy() @ normal, offset, atol=1e-12)
    single = lifted(torch.from_numpy(depths.astype(np.float32)), view).numpy()
    assert np.abs(single - expected.reshape(-1, 3)).max() < 1e-5 * np.abs(depths).max()


@pytest.mark.parametrize("antialiased", [False, True])
def test_the_depth_of_a_wall_is_where_it_stands(antialiased):
    view = camera(20, 15)
    found = rendered_depth(wall(3.0, view), view, 0.1, antialiased)
    assert np.abs(found - 3).max() < 1e-3
    resting = np.abs(lifted(torch.from_numpy(found), view).numpy() @ view.rotation[2] + view.world_to_camera[2, 3] - 3)
    assert resting.max() < 1e-3


def test_where_next_to_nothing_is_there_is_no_depth():
    view = camera(20, 15)
    half = wall(3.0, view)
    right = (half["means"].numpy() @ view.rotation[0] + view.world_to_camera[0, 3]) > 0
    found = rendered_depth({name: value[right] for name, value in half.items()}, view, 0.1, False)
    assert np.isnan(found[:, :8]).all()
    assert np.abs(found[:, 12:] - 3).max() < 1e-3
    none, faint = {k: v[:0] for k, v in half.items()}, {**half, "opacity_logits": half["opacity_logits"] - 12}
    for gaussians in (none, faint):
        assert np.isnan(rendered_depth(gaussians, view, 0.1, False)).all()
