"""Camera paths of films: closed, even, through where the cameras stood, looking where they looked."""

import numpy as np
import pytest

from baselines.rendering.camera_paths import camera_path, look_at, nearest_to_axes
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points, no_points

UP = np.array([0.0, 0.0, 1.0])
AHEAD = np.array([0.0, 1.0, 0.0])
TARGET = np.array([5.0, -2.0, 1.0])


def looking(eye, target) -> Camera:
    return Camera(64, 48, 60, 60, 30, 25, look_at(np.asarray(eye, float), np.asarray(target, float), UP))


def ring(n: int = 24, radii=(3.0, 2.0), height: float = 1.5) -> list[Camera]:
    angles = 2 * np.pi * np.arange(n) / n
    offsets = np.stack([radii[0] * np.cos(angles), radii[1] * np.sin(angles), np.full(n, height)], axis=1)
    return [looking(TARGET + offset, TARGET) for offset in offsets]


def wall(target_depth: float | None) -> list[Camera]:
    """A grid of cameras in one plane that look along y, or at a point straight ahead."""
    eyes = [np.array([x, 0.0, z]) for x in np.linspace(-1, 1, 5) for z in np.linspace(-0.5, 0.5, 4)]
    return [looking(eye, [0, target_depth, 0] if target_depth else eye + AHEAD) for eye in eyes]


def centres(path: list[Camera]) -> np.ndarray:
    return np.array([camera.centre for camera in path])


def test_look_at_points_the_camera():
    camera = looking([1, 2, 3], TARGET)
    assert np.allclose(camera.centre, [1, 2, 3])
    assert np.allclose(camera.rotation @ camera.rotation.T, np.eye(3))
    assert np.linalg.det(camera.rotation) == pytest.approx(1)
    assert np.allclose(camera.project(TARGET[None])[0], [30, 25])
    assert camera.rotation[1] @ UP < 0  # y points down


def test_axes_meet_where_the_cameras_look():
    cameras = ring()
    forwards = np.array([camera.rotation[2] for camera in cameras])
    assert np.allclose(nearest_to_axes(centres(cameras), forwards), TARGET)
    with pytest.raises(InputError, match="parallel"):
        nearest_to_axes(centres(cameras), np.tile([0, 1.0, 0], (len(cameras), 1)))


def test_a_ring_gets_an_ellipse_at_even_distances():
    path = camera_path(ring(), no_points(), 40)
    eyes = centres(path)
    steps = np.linalg.norm(np.diff(eyes, axis=0, append=eyes[:1]), axis=1)
    assert steps.max() < 1.03 * steps.min()  # the last one leads back to the first
    assert np.allclose(eyes[:, 2], TARGET[2] + 1.5)
    assert np.ptp(eyes[:, 0]) == pytest.approx(6, rel=0.1)
    assert np.ptp(eyes[:, 1]) == pytest.approx(4, rel=0.1)
    for camera in path:
        assert np.allclose(camera.project(TARGET[None])[0], [32, 24])
        assert camera.rotation[1] @ UP < 0


def test_a_wall_of_cameras_gets_a_spiral_through_them():
    points = Points(np.array([[0, 3.0, 0], [0.3, 5, 0.1], [0, -4, 0]]), np.zeros((3, 3), np.uint8))
    path = camera_path(wall(None), points, 60)
    eyes = centres(path)
    assert np.allclose(np.ptp(eyes, axis=0), [2, 0, 1], atol=0.15)
    assert (np.abs(eyes) <= [1 + 1e-9, 1e-9, 0.5 + 1e-9]).all()
    steps = np.linalg.norm(np.diff(eyes, axis=0, append=eyes[:1]), axis=1)
    assert steps.max() < 3 * np.median(steps)  # closed
    axes = np.array([camera.rotation[2] for camera in path])
    depth = nearest_to_axes(eyes, axes)[1]
    near, far = 0.9 * 3, 5 * 5
    assert depth == pytest.approx(1 / (0.25 / near + 0.75 / far), rel=0.01)


def test_without_points_a_spiral_looks_where_the_axes_meet():
    path = camera_path(wall(4.0), no_points(), 30)
    assert np.allclose(nearest_to_axes(centres(path), np.array([c.rotation[2] for c in path])), [0, 4, 0], atol=0.05)
    with pytest.raises(InputError, match="parallel"):
        camera_path(wall(None), no_points(), 30)
    with pytest.raises(InputError, match="behind"):
        camera_path([looking(eye, 2 * eye + 4 * AHEAD) for eye in centres(wall(None))], no_points(), 30)
