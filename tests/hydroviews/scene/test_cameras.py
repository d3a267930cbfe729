import numpy as np
import pytest
from synthetic import ring_camera

from hydroviews.scene.cameras import Camera, fitted_size, same_shape


def test_projection_by_hand():
    camera = Camera(100, 80, 50.0, 60.0, 49.0, 41.0, np.eye(4))
    pixels, depths = camera.project([[0, 0, 2], [1, -1, 4], [0, 0, -1]])
    np.testing.assert_allclose(pixels[:2], [[49, 41], [49 + 12.5, 41 - 15]])
    np.testing.assert_allclose(depths, [2, 4, -1])
    assert np.isfinite(pixels).all()


def test_resizing_scales_projections_exactly():
    camera = ring_camera(0.3, 101, 77)
    small = camera.resized(50, 38)
    points = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_allclose(small.project(points)[0], camera.project(points)[0] * (50 / 101, 38 / 77), atol=1e-12)
    np.testing.assert_allclose(small.resized(101, 77).matrix, camera.matrix, rtol=1e-14)


@pytest.mark.parametrize(
    ("size", "long_side", "expected"),
    [
        ((800, 533), 400, (400, 267)),  # 266.5 rounds up
        ((798, 531), 400, (400, 266)),
        ((450, 800), 400, (225, 400)),
        ((800, 533), 900, (800, 533)),
        ((800, 533), None, (800, 533)),
        ((1000, 1), 10, (10, 1)),
    ],
)
def test_fitted_size(size, long_side, expected):
    assert fitted_size(*size, long_side) == expected


@pytest.mark.parametrize(
    ("size", "other", "expected"),
    [
        ((800, 533), (800, 533), True),
        ((4946, 3286), (1237, 822), True),  # rounded up
        ((4946, 3286), (1236, 821), True),  # rounded down
        ((1237, 822), (4946, 3286), True),
        ((4032, 3024), (800, 600), True),
        ((800, 533), (800, 534), False),
        ((800, 533), (533, 800), False),
        ((800, 600), (400, 310), False),
        ((1600, 900), (800, 600), False),
    ],
)
def test_same_shape(size, other, expected):
    assert same_shape(size, other) is expected
