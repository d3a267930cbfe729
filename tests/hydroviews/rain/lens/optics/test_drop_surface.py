import numpy as np
import pytest

from hydroviews.rain.lens.optics.drop_surface import cap_volume, triangle_areas, water_surface
from hydroviews.rain.lens.patterns.shapes import Outline, Patch, drop_patch, ribbon, rim_of

ROUND = Outline(((0.3, -0.2, 0.5),))
MERGED = Outline(((0.0, 0.0, 1.0), (1.1, 0.4, 0.8), (0.3, 1.4, 0.7)), 1.2, ((0.05, 1.0), (0.03, 2.0)))


def volume(patch: Patch, height: np.ndarray) -> float:
    return float((triangle_areas(patch.vertices, patch.triangles) * height[patch.triangles].mean(axis=1)).sum())


@pytest.mark.parametrize("degrees", [10, 45, 80])
def test_a_round_drop_without_gravity_is_a_spherical_cap(degrees):
    angle = np.radians(degrees)
    (patch,), (height,) = water_surface([drop_patch(ROUND, angle, 64, 20)], np.inf)
    distance = np.linalg.norm(patch.vertices - [0.3, -0.2], axis=1)
    curvature = 0.5 / np.sin(angle)
    expected = np.sqrt(curvature**2 - np.minimum(distance, 0.5) ** 2) - curvature * np.cos(angle)
    np.testing.assert_allclose(height, expected, atol=0.01 * expected.max())
    assert volume(patch, height) == pytest.approx(cap_volume(0.5, angle), rel=0.01)


def test_gravity_makes_the_belly_hang_as_the_linear_solution_says():
    # -laplace(phi) = 4 (1 + b y / r) on a disk has the solution (r^2 - x^2 - y^2) (1 + b y / 2 r).
    angle = np.radians(8)
    patch = drop_patch(Outline(((0.0, 0.0, 0.5),)), angle, 96, 24)
    (scaled,), (height,) = water_surface([patch], capillary_length=1.0)
    x, y = scaled.vertices.T
    expected = (0.25 - x**2 - y**2) * (1 + 0.25 / (2 * np.tan(angle)) * y) * np.tan(angle)
    np.testing.assert_allclose(height, expected, atol=0.02 * expected.max())
    assert height[(y > 0.2) & ~patch.rim].mean() > 1.2 * height[(y < -0.2) & ~patch.rim].mean()


@pytest.mark.parametrize("capillary_length", [np.inf, 1.0])
def test_a_merged_drop_holds_the_water_of_its_parts(capillary_length):
    angle = np.radians(50)
    (patch,), (height,) = water_surface([drop_patch(MERGED, angle, 72, 18)], capillary_length)
    assert volume(patch, height) == pytest.approx(sum(cap_volume(r, angle) for *_, r in MERGED.disks), rel=1e-6)


def test_steep_drops_are_finite_and_their_triangles_keep_their_side():
    path = np.column_stack([0.1 * np.sin(np.linspace(0, 6, 60)), np.linspace(0, 3, 60)])
    widths = 0.1 + 0.05 * np.sin(np.linspace(0, 9, 60))
    patches = [drop_patch(MERGED, np.pi / 2, 48, 12), ribbon(path, widths, np.pi / 2)]
    scaled, heights = water_surface(patches, 0.5)
    for patch, height in zip(scaled, heights, strict=True):
        assert np.all(np.isfinite(patch.vertices))
        assert np.all(triangle_areas(patch.vertices, patch.triangles) > 0)
        assert np.all(height[patch.rim] == 0)
        assert np.all(height[~patch.rim] > 0)


def test_disks_grow_together_over_a_neck():
    rim = rim_of(Outline(((-1.0, 0.0, 1.0), (1.0, 0.0, 1.0))), 360)
    assert np.ptp(rim[:, 0]) == pytest.approx(4, rel=0.05)
    assert np.ptp(rim[:, 1]) == pytest.approx(2, rel=0.1)
    assert 0.3 < np.abs(rim[np.abs(rim[:, 0]) < 0.05, 1]).max() < 0.9
