import numpy as np
import OpenEXR
import pytest
from synthetic import capture_in

from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.depth import (
    depth_path,
    fitted_depth,
    read_depth,
    resized_depth,
    sparse_depth,
    view_depth,
    write_depth,
)

CAMERA = Camera(96, 72, 90, 90, 48, 36, np.eye(4))


def plane(n: int = 3000, tilt: float = 0.4) -> np.ndarray:
    """Points of a tilted wall about 4 units away, in front of CAMERA."""
    x, y = np.random.default_rng(0).uniform(-3, 3, (2, n))
    return np.stack([x, y, 4 + tilt * x], axis=1)


def exact(tilt: float = 0.4) -> np.ndarray:
    """Depth of that wall at every pixel."""
    rays = (np.arange(96) + 0.5 - 48) / 90
    return np.tile(4 / (1 - tilt * rays), (72, 1))


def test_maps_come_back_and_sky_is_infinite(tmp_path):
    depth = np.array([[1.5, np.inf, 1e10], [0.0, -2.0, np.nan]])
    write_depth(tmp_path / "a.exr", depth)
    assert np.array_equal(read_depth(tmp_path / "a.exr"), np.array([[1.5, np.inf, np.inf], [np.inf] * 3], np.float32))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.exr", "no such depth map"),
        ("text.exr", "not a readable EXR"),
        ("colour.exr", "no depth in it"),
        ("narrow.exr", "image and camera differ in size"),
    ],
)
def test_bad_maps_are_refused(tmp_path, name, message):
    (tmp_path / "text.exr").write_text("not an exr")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"R": np.ones((3, 4), np.float32)}).write(str(tmp_path / "colour.exr"))
    write_depth(tmp_path / "narrow.exr", np.ones((CAMERA.height, CAMERA.width // 2), np.float32))
    with pytest.raises(InputError, match=message):
        fitted_depth(tmp_path / name, CAMERA)


def test_a_views_own_map_goes_before_points(tmp_path):
    scene = capture_in(tmp_path / "scene")
    view = scene.views[2]
    assert depth_path(view) == tmp_path / "scene" / "depth" / "view-02.exr"
    guessed = view_depth(view, scene.points)
    write_depth(depth_path(view), np.full((72, 96), 7.0))  # twice the view's size
    known = view_depth(view, scene.points)
    assert known.shape == guessed.shape == (36, 48)
    assert (known == 7).all()
    assert np.allclose(guessed, 4, atol=1.5)  # cameras stand 4 units from a cloud of points


@pytest.mark.parametrize("size", [(3, 2), (6, 4), (12, 8), (5, 3), (1, 1)])
def test_resizing_invents_no_depths(size):
    depth = np.where(np.arange(24).reshape(4, 6) % 6 < 3, 1.0, np.inf)
    width, height = size
    resized = resized_depth(depth, width, height)
    assert resized.shape == (height, width)
    assert set(np.unique(resized)) <= {np.float32(1), np.float32(np.inf)}
    if width % 2 == 0:
        assert np.array_equal(resized, np.tile(np.where(np.arange(width) < width / 2, 1.0, np.inf), (height, 1)))


def test_a_tilted_wall_is_found_from_its_points():
    error = np.abs(sparse_depth(CAMERA, plane()) / exact() - 1)
    assert np.median(error) < 0.02
    assert np.quantile(error, 0.99) < 0.06


def test_points_behind_a_wall_do_not_show_through():
    behind = np.random.default_rng(1).uniform((-6, -6, 9), (6, 6, 12), (800, 3))
    depth = sparse_depth(CAMERA, np.concatenate([plane(), behind]))
    assert np.quantile(depth / exact(), 0.97) < 1.1


def test_edges_are_not_smeared_over_the_picture():
    near = np.random.default_rng(2).uniform((-1.2, -1.6, 2), (0, 1.6, 2), (4000, 3))  # its left half, at 2
    depth = sparse_depth(CAMERA, np.concatenate([near, plane(tilt=0)]))
    assert np.abs(depth[:, :42] - 2).max() < 0.1
    assert np.abs(depth[:, 54:] - 4).max() < 0.1


@pytest.mark.parametrize(("width", "height"), [(1, 1), (17, 3), (1, 40)])
def test_tiny_pictures_and_few_points(width, height):
    small = CAMERA.resized(width, height)
    assert sparse_depth(small, plane()).shape == (height, width)
    assert np.isfinite(sparse_depth(small, plane())).all()
    assert np.allclose(sparse_depth(small, np.array([[0, 0, 3.0]])), 3)
    assert np.isinf(sparse_depth(small, np.array([[0, 0, -3.0], [100, 0, 1]]))).all()  # none in view
