"""From pixels to points: against closed forms in float64, and depths of walls that are where they were put."""

import numpy as np
import pytest
import torch
from splats import camera

from baselines.splatting.gaussians import Gaussians
from baselines.wild_gs.lifting import lifted, rendered_depth


def wall(depth, view, count=40, reach=3.0):
    """Opaque Gaussians close together on the plane at a depth before a camera, as tensors."""
    axis = np.linspace(-reach, reach, count)
    local = np.stack([*np.meshgrid(axis, axis), np.full((count, count), depth)], axis=-1).reshape(-1, 3)
    means = (local - view.world_to_camera[:3, 3]) @ view.rotation
    n = len(means)
    gaussians = Gaussians(
        means=means.astype(np.float32),
        quaternions=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        log_scales=np.full((n, 3), np.log(0.1), np.float32),
        opacity_logits=np.full(n, 6, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )
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
    none = {name: value[:0] for name, value in half.items()}
    assert np.isnan(rendered_depth(none, view, 0.1, False)).all()
    faint = {**half, "opacity_logits": half["opacity_logits"] - 12}
    assert np.isnan(rendered_depth(faint, view, 0.1, False)).all()
