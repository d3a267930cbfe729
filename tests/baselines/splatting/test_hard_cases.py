"""Cases at the edge of what float32 and the renderer's cut-offs allow, against float64 or against a stated answer."""

from dataclasses import replace

import numpy as np
import pytest
from against_float64 import assert_absent, assert_same, exactly, rendered
from splats import camera, cloud, with_values

from baselines.splatting.gaussians import FIELDS
from hydroviews.scene.cameras import Camera

WIDTH, HEIGHT = 40, 28
UPRIGHT, OBLIQUE = [1, 0, 0, 0], [0.9, 0.2, -0.3, 0.4]
AHEAD = Camera(WIDTH, HEIGHT, 36.0, 36.0, WIDTH / 2, HEIGHT / 2, np.eye(4))  # at the origin, looking along z


def first(**values):
    """Gaussians of all shapes four units in front of AHEAD, the first with these values."""
    gaussians = cloud(30, 1)
    gaussians = replace(gaussians, means=gaussians.means + np.array([0, 0, 4], np.float32))
    for name, value in values.items():
        gaussians = with_values(gaussians, name, 0, value)
    return gaussians


def needle(axis, length, thickness, **values):
    """The same, the first a needle three units away."""
    scales = np.full(3, np.log(thickness))
    scales[axis] = np.log(length)
    return first(log_scales=scales, means=[0.1, 0.05, 3.0], **values)


def row_of(depths, logit, scale=0.2, degree=0):
    """Round Gaussians on the optical axis of AHEAD, of several colours."""
    gaussians = with_values(cloud(len(depths), degree, seed=4), "means", slice(None), 0)
    gaussians = with_values(gaussians, "means", np.s_[:, 2], depths)
    gaussians = with_values(gaussians, "log_scales", slice(None), np.log(scale))
    return with_values(gaussians, "opacity_logits", slice(None), logit)


SCREENS = {f"{n:g} screens wide": np.log(n * np.array([4, 9, 3.0])) for n in (30, 3e4, 3e7)}
INSIDE = {"camera inside, round": 0.0, "camera inside, long": [1, -1, 0.5], "camera inside, huge": 5.0}
ODD = [
    pytest.param({"log_scales": 40.0}, True, id="a scale of e^40 is a flat colour"),
    pytest.param({"opacity_logits": 20.0}, True, id="opacity of one"),
    pytest.param({"opacity_logits": 1000.0}, True, id="opacity of one beyond float32's exp"),
    *(
        pytest.param({"means": centre, "log_scales": scales}, None, id=f"{name}, centre at {centre}")
        for name, scales in SCREENS.items()
        for centre in ((0.3, -0.2, 4), (60, 5, 4))
    ),
    *(
        pytest.param({"means": centre, "log_scales": scales}, centre[2] > 0.01, id=f"{name}, centre at {centre}")
        for name, scales in INSIDE.items()
        for centre in ((0, 0, 0.3), (0.2, -0.4, 0.05), (0, 0, 0), (0.1, 0, -0.2))
    ),
]


@pytest.mark.parametrize(("values", "shown"), ODD)
def test_an_odd_gaussian_among_others(values, shown):
    state = assert_same(first(**values), AHEAD, gradient_error=1e-4, first_error=1e-4)
    assert shown is None or state.visible[0] == shown


@pytest.mark.parametrize(
    "values",
    [
        *({"log_scales": axes, "quaternions": UPRIGHT} for axes in (100, [100, -2, -2], [100, 100, -2])),
        *({"opacity_logits": logit} for logit in (-20.0, -88.0, -1000.0)),
    ],
    ids=str,
)
def test_what_is_infinite_in_float32_or_transparent_is_culled(values):
    assert_absent(first(**values), AHEAD, 0)


@pytest.mark.parametrize(("toward", "shown"), [(0.0, False), (0.5, False), (1.0, True)])
@pytest.mark.parametrize("log_scale", [-4.0, 0.0])
def test_at_the_near_plane_and_a_hair_on_both_sides(toward, shown, log_scale):
    depth = np.nextafter(np.float32(0.5), np.float32(toward))  # 0.5 toward itself is 0.5
    gaussians = first(means=[0.01, 0, depth], log_scales=log_scale)
    assert assert_same(gaussians, AHEAD, gradient_error=1e-4, first_error=1e-4, near=0.5).visible[0] == shown


def endless(axis, log_length, quaternion=OBLIQUE):
    return needle(axis, np.exp(np.float64(log_length)), np.exp(-2), quaternions=quaternion)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("log_length", [10, 15, 20, 30, 40, 80])
def test_an_endless_needle_looks_and_moves_like_a_very_long_one(axis, log_length):
    exact, expected = exactly(endless(axis, 10), AHEAD, near=0.01)
    image, _, gradients = rendered(endless(axis, log_length), AHEAD)
    assert np.abs(image - exact).max() < 1e-5
    if log_length <= 30:
        for name in FIELDS:
            error = np.linalg.norm(gradients[name][0] - expected[name][0])
            assert error <= 1e-3 * np.linalg.norm(expected[name][0]), name


@pytest.mark.parametrize(("axis", "quaternion"), [(1, UPRIGHT), (2, UPRIGHT), (0, OBLIQUE), (1, OBLIQUE), (2, OBLIQUE)])
def test_an_infinite_needle_has_finite_gradients(axis, quaternion):
    _, _, gradients = rendered(endless(axis, 100, quaternion), AHEAD)
    assert all(np.isfinite(gradient).all() for gradient in gradients.values())


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("length", "ratio"), [(1.0, 1e4), (1.0, 1e6), (30.0, 1e4), (30.0, 1e6)])
@pytest.mark.parametrize("tilt", [0.0, 0.01, 0.7])
def test_needles_from_the_side_and_along_their_length(axis, length, ratio, tilt):
    """Along z one looks along the needle; a hair of tilt makes the covariance as ill-conditioned as can be."""
    quaternion = [np.cos(tilt / 2), *(np.sin(tilt / 2) * np.array([0.6, 0.8, 0]))]
    gaussians = needle(axis, length, length / ratio, quaternions=quaternion, opacity_logits=2.0)
    assert assert_same(gaussians, AHEAD, image_error=1e-4, gradient_error=1e-3, first_error=1e-3).visible[0]


def layers(opacity, turned=False):
    """Three hundred flat ones, each over the whole picture."""
    depths = np.linspace(2, 8, 300, dtype=np.float32)
    return row_of(depths[::-1] if turned else depths, np.log(opacity / (1 - opacity)), scale=30.0)


def learning(gradients):
    return np.flatnonzero(gradients["sh"].any(axis=(1, 2))).tolist()


@pytest.mark.parametrize("turned", [False, True])
def test_three_hundred_opaque_layers(turned):
    """Two are seen, as after a third less than 1e-4 would be left."""
    gaussians = layers(0.985, turned)
    upright = replace(gaussians, quaternions=np.tile(np.float32(UPRIGHT), (300, 1)))
    assert assert_same(upright, AHEAD, gradient_error=1e-4).visible.all()
    assert learning(rendered(gaussians, AHEAD)[2]) == ([298, 299] if turned else [0, 1])


@pytest.mark.parametrize("turned", [False, True])
def test_three_hundred_saturated_layers_show_the_first_before_the_background(turned):
    """Opacities are held at 0.99. In float32 a second one would leave less than 1e-4, as in Kerbl et al.'s renderer."""
    gaussians, nearest = layers(0.999, turned), 299 if turned else 0
    alone = gaussians.select(np.array([nearest]))
    image, _, gradients = rendered(gaussians, AHEAD)
    assert image.tobytes() == rendered(alone, AHEAD)[0].tobytes()
    assert np.abs(image - exactly(alone, AHEAD)[0]).max() < 1e-6
    assert learning(gradients) == [nearest]


@pytest.mark.parametrize("value", [0.0, 1e-40, -1e-40, 1e-45])
def test_a_quaternion_of_no_length_is_no_rotation(value):
    gaussians = first(quaternions=value)
    assert_same(gaussians, AHEAD, gradient_error=1e-4)
    image, _, gradients = rendered(gaussians, AHEAD)
    assert image.tobytes() == rendered(first(quaternions=UPRIGHT), AHEAD)[0].tobytes()
    assert not gradients["quaternions"][0].any()


@pytest.mark.parametrize("length", [1e-10, 1e18])
def test_a_quaternion_of_any_length_is_its_direction(length):
    scaled = first(quaternions=first().quaternions[0] * np.float32(length))
    assert np.abs(rendered(first(), AHEAD)[0] - rendered(scaled, AHEAD)[0]).max() < 1e-6


@pytest.mark.parametrize("direction", [(1, 0, 0), (1, -2, 0.5), (0, 0, 1)])
def test_a_scene_far_from_zero_is_as_accurate_as_one_at_zero(direction):
    gaussians, offset = cloud(80, 2), tuple(1e5 * np.array(direction))
    exact, exact_gradients = exactly(gaussians, camera(WIDTH, HEIGHT))
    far = replace(gaussians, origin=np.array(offset))
    image, _, gradients = rendered(far, camera(WIDTH, HEIGHT, origin=offset))
    assert np.abs(image - exact).max() < 2e-6
    for name in FIELDS:
        error = np.linalg.norm(gradients[name] - exact_gradients[name])
        assert error <= 1e-5 * np.linalg.norm(exact_gradients[name]), name


def test_a_thousand_gaussians_in_one_pixel():
    gaussians = row_of(np.linspace(4, 5, 1000, dtype=np.float32), logit=-5.0, scale=1e-3, degree=1)
    offset = np.float32(0.5 / 36)  # to the middle of a pixel, at the depth of each
    gaussians.means[:, :2] = offset * gaussians.means[:, 2:]
    state = assert_same(gaussians, AHEAD, gradient_error=1e-3)
    assert state.visible.all()
    assert state.last.max() == 1000


def test_thousands_of_equal_depths_are_blended_in_index_order():
    gaussians = with_values(cloud(4000, 0, size=0.05), "means", np.s_[:, 2], 4)
    gaussians = replace(gaussians, opacity_logits=gaussians.opacity_logits - 2)
    state = assert_same(gaussians, replace(AHEAD, width=24, height=16, cx=12.0, cy=8.0), gradient_error=1e-4)
    assert np.array_equal(state.order, np.flatnonzero(state.visible))


@pytest.mark.parametrize("name", FIELDS)
def test_every_kind_of_number_that_is_none_at_once(name):
    gaussians = cloud(600, 2, seed=7, size=0.08)
    kinds = {"opacity_logits": [np.nan, -np.inf], "log_scales": [np.nan, np.inf]}.get(name, [np.nan, np.inf, -np.inf])
    for start, value in enumerate(kinds):
        gaussians = with_values(gaussians, name, slice(start, 100, len(kinds)), value)
    assert_absent(gaussians, camera(70, 50), np.arange(100))
