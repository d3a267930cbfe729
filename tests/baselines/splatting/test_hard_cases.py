"""Cases at the edge of what float32 and the renderer's cut-offs allow, against float64 or against a stated answer."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import BACKGROUND, camera, cloud, with_values

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.photometric import photometric_loss, prepare_target
from baselines.splatting.rasterizer import backward, render
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import to_uint8

WIDTH, HEIGHT = 40, 28
UPRIGHT, OBLIQUE = [1, 0, 0, 0], [0.9, 0.2, -0.3, 0.4]
AHEAD = Camera(WIDTH, HEIGHT, 36.0, 36.0, WIDTH / 2, HEIGHT / 2, np.eye(4))  # at the origin, looking along z


def aside(n=30, degree=1, seed=0):
    """Gaussians of all shapes four units in front of AHEAD; tests change the first."""
    gaussians = cloud(n, degree, seed)
    return replace(gaussians, means=gaussians.means + np.array([0, 0, 4], np.float32))


def row_of(depths, logit, scale=0.2, degree=0):
    """Round Gaussians on the optical axis of AHEAD, of several colours."""
    n = len(depths)
    gaussians = cloud(n, degree, seed=4)
    means = np.zeros((n, 3), np.float32)
    means[:, 2] = depths
    scales = np.full((n, 3), np.log(scale), np.float32)
    return replace(gaussians, means=means, log_scales=scales, opacity_logits=np.full(n, logit, np.float32))


def rendered(gaussians, view, near=0.01):
    """Image, state and gradients of a random linear loss, by the kernels."""
    weights = np.random.default_rng(1).normal(size=(view.height, view.width, 3)).astype(np.float32)
    image, state = render(gaussians, view, BACKGROUND, near=near)
    return image, state, backward(state, weights).parameters.state_dict()


def exactly(gaussians, view, near=0.01):
    """Image and gradients of the same loss, by the float64 reference."""
    weights = np.random.default_rng(1).normal(size=(view.height, view.width, 3)).astype(np.float32)
    parameters = reference.tensors(gaussians)
    image = reference.render(parameters, view, torch.from_numpy(BACKGROUND), gaussians.sh_degree, near)
    (image * torch.from_numpy(weights)).sum().backward()
    return image.detach().numpy(), {name: value.grad.numpy() for name, value in parameters.items()}


def assert_same(gaussians, view, image_error=1e-5, gradient_error=1e-4, near=0.01):
    """The kernels agree with float64: every pixel, and the gradients of the first Gaussian and of all."""
    image, state, gradients = rendered(gaussians, view, near)
    exact, exact_gradients = exactly(gaussians, view, near)
    assert np.abs(image - exact).max() <= image_error
    for name in FIELDS:
        ours, theirs = gradients[name], exact_gradients[name]
        assert np.linalg.norm(ours - theirs) <= gradient_error * np.linalg.norm(theirs) + 1e-9, name
        largest = max(np.linalg.norm(theirs[0]), 1e-3 * np.abs(theirs).max())
        assert np.linalg.norm(ours[0] - theirs[0]) <= gradient_error * largest + 1e-9, f"{name} of the first"
    return state


def assert_absent(gaussians, view, rows):
    """The Gaussians `rows` are culled: image and gradients of the others are bit for bit what they are without."""
    rows = np.atleast_1d(rows)
    others = np.setdiff1d(np.arange(len(gaussians)), rows)
    image, state, gradients = rendered(gaussians, view)
    without, _, expected = rendered(gaussians.select(others), view)
    assert not state.visible[rows].any()
    assert image.tobytes() == without.tobytes()
    for name in FIELDS:
        assert not gradients[name][rows].any(), name
        assert gradients[name][others].tobytes() == expected[name].tobytes(), name


@pytest.mark.parametrize(("toward", "shown"), [(0.0, False), (0.5, False), (1.0, True)])
@pytest.mark.parametrize("log_scale", [-4.0, 0.0])
def test_at_the_near_plane_and_a_hair_on_both_sides(toward, shown, log_scale):
    depth = np.nextafter(np.float32(0.5), np.float32(toward))  # 0.5 toward itself is 0.5
    gaussians = with_values(with_values(aside(), "means", 0, [0.01, 0, depth]), "log_scales", 0, log_scale)
    assert assert_same(gaussians, AHEAD, near=0.5).visible[0] == shown


@pytest.mark.parametrize("centre", [(0.3, -0.2, 4), (60, 5, 4)])
@pytest.mark.parametrize("screens", [30, 3e4, 3e7])
def test_an_ellipse_many_screens_wide(screens, centre):
    shape = np.log(screens * np.array([4, 9, 3.0]))
    gaussians = with_values(with_values(aside(), "means", 0, centre), "log_scales", 0, shape)
    state = assert_same(gaussians, AHEAD)
    assert (state.transmittance < 0.999).all() == state.visible[0]


def test_a_scale_of_e40_is_a_flat_colour():
    gaussians = with_values(aside(), "log_scales", 0, 40.0)
    state = assert_same(gaussians, AHEAD)
    assert state.visible[0]


@pytest.mark.parametrize("axes", [[100, 100, 100], [100, -2, -2], [100, 100, -2]])
def test_a_scale_of_e100_is_infinite_in_float32_and_culled(axes):
    assert_absent(with_values(with_values(aside(), "log_scales", 0, axes), "quaternions", 0, UPRIGHT), AHEAD, 0)


def needle(axis, log_length, quaternion):
    """Gaussians of which the first is thin and `log_length` long."""
    scales = np.full(3, -2.0)
    scales[axis] = log_length
    gaussians = with_values(with_values(aside(), "log_scales", 0, scales), "quaternions", 0, quaternion)
    return with_values(gaussians, "means", 0, [0.1, 0.05, 3.0])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("log_length", [15, 20, 40, 80])
def test_an_endless_needle_looks_like_a_very_long_one(axis, log_length):
    exact, _ = exactly(needle(axis, 10, OBLIQUE), AHEAD)
    assert np.abs(rendered(needle(axis, log_length, OBLIQUE), AHEAD)[0] - exact).max() < 1e-5


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("log_length", [10, 15, 20, 30])
def test_an_endless_needle_moves_like_a_very_long_one(axis, log_length):
    _, expected = exactly(needle(axis, 10, OBLIQUE), AHEAD)
    _, _, gradients = rendered(needle(axis, log_length, OBLIQUE), AHEAD)
    for name in FIELDS:
        error = np.linalg.norm(gradients[name][0] - expected[name][0])
        assert error <= 1e-3 * np.linalg.norm(expected[name][0]), name


@pytest.mark.parametrize(
    ("axis", "quaternion"),
    [
        (1, UPRIGHT),
        *((axis, OBLIQUE) for axis in (0, 1, 2)),
        (2, UPRIGHT),
    ],
)
def test_an_infinite_needle_has_finite_gradients(axis, quaternion):
    _, _, gradients = rendered(needle(axis, 100, quaternion), AHEAD)
    assert all(np.isfinite(gradient).all() for gradient in gradients.values())


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("length", "ratio"), [(1.0, 1e4), (1.0, 1e6), (30.0, 1e4), (30.0, 1e6)])
@pytest.mark.parametrize("tilt", [0.0, 0.01, 0.7])
def test_needles_from_the_side_and_along_their_length(axis, length, ratio, tilt):
    """Along z one looks along the needle; a hair of tilt makes the covariance as ill-conditioned as can be."""
    scales = np.full(3, np.log(length / ratio))
    scales[axis] = np.log(length)
    gaussians = with_values(aside(), "log_scales", 0, scales)
    gaussians = with_values(gaussians, "means", 0, [0.1, 0.05, 3.0])
    gaussians = with_values(
        gaussians, "quaternions", 0, [np.cos(tilt / 2), *(np.sin(tilt / 2) * np.array([0.6, 0.8, 0]))]
    )
    gaussians = with_values(gaussians, "opacity_logits", 0, 2.0)
    assert assert_same(gaussians, AHEAD, image_error=1e-4, gradient_error=1e-3).visible[0]


@pytest.mark.parametrize("logit", [20.0, 88.0, 1000.0])
def test_opacity_of_one(logit):
    gaussians = with_values(aside(), "opacity_logits", 0, logit)
    assert assert_same(gaussians, AHEAD).visible[0]
    assert not rendered(gaussians, AHEAD)[2]["opacity_logits"][0] > 1e-6


@pytest.mark.parametrize("logit", [-20.0, -88.0, -1000.0])
def test_opacity_of_nothing(logit):
    assert_absent(with_values(aside(), "opacity_logits", 0, logit), AHEAD, 0)


def layers(opacity, turned):
    """Three hundred flat ones, each over the whole picture."""
    depths = np.linspace(2, 8, 300, dtype=np.float32)
    return row_of(depths[::-1] if turned else depths, np.log(opacity / (1 - opacity)), scale=30.0)


@pytest.mark.parametrize("turned", [False, True])
def test_three_hundred_opaque_layers(turned):
    """Two are seen, as after a third less than 1e-4 would be left."""
    gaussians = layers(0.985, turned)
    state = assert_same(replace(gaussians, quaternions=np.tile(np.float32(UPRIGHT), (300, 1))), AHEAD)
    nearest = [299, 298] if turned else [0, 1]
    assert state.visible.all()
    assert np.flatnonzero(rendered(gaussians, AHEAD)[2]["sh"].any(axis=(1, 2))).tolist() == sorted(nearest)


@pytest.mark.parametrize("turned", [False, True])
def test_three_hundred_saturated_layers_show_the_first_before_the_background(turned):
    """Opacities are held at 0.99. In float32 a second one would leave less than 1e-4, as in Kerbl et al.'s renderer."""
    gaussians = layers(0.999, turned)
    first = gaussians.select(np.array([299 if turned else 0]))
    image, state, gradients = rendered(gaussians, AHEAD)
    assert image.tobytes() == rendered(first, AHEAD)[0].tobytes()
    assert np.abs(image - exactly(first, AHEAD)[0]).max() < 1e-6
    assert (state.last == 1).all()
    assert len(np.flatnonzero(gradients["sh"].any(axis=(1, 2)))) == 1


def test_two_saturated_layers_are_the_same_in_both_precisions():
    assert_same(layers(0.999, False).select(np.arange(2)), AHEAD)


@pytest.mark.parametrize("value", [0.0, 1e-40, -1e-40, 1e-45])
def test_a_quaternion_of_no_length_is_no_rotation(value):
    gaussians = with_values(aside(), "quaternions", 0, value)
    assert_same(gaussians, AHEAD)
    straight = with_values(gaussians, "quaternions", 0, [1, 0, 0, 0])
    image, _, gradients = rendered(gaussians, AHEAD)
    assert image.tobytes() == rendered(straight, AHEAD)[0].tobytes()
    assert not gradients["quaternions"][0].any()


@pytest.mark.parametrize("direction", [(1, 0, 0), (1, -2, 0.5), (0, 0, 1)])
def test_a_scene_far_from_zero_is_as_accurate_as_one_at_zero(direction):
    gaussians, offset = cloud(80, 2), tuple(1e5 * np.array(direction))
    exact, exact_gradients = exactly(gaussians, camera(WIDTH, HEIGHT))
    far = replace(gaussians, origin=np.array(offset))
    for scene, view in ((gaussians, camera(WIDTH, HEIGHT)), (far, camera(WIDTH, HEIGHT, origin=offset))):
        image, _, gradients = rendered(scene, view)
        assert np.abs(image - exact).max() < 2e-6
        for name in FIELDS:
            error = np.linalg.norm(gradients[name] - exact_gradients[name])
            assert error <= 1e-5 * np.linalg.norm(exact_gradients[name]), name


@pytest.mark.parametrize("log_scale", [0.0, [1, -1, 0.5], 5.0])
@pytest.mark.parametrize("centre", [(0, 0, 0.3), (0.2, -0.4, 0.05), (0, 0, 0), (0.1, 0, -0.2)])
def test_a_camera_inside_a_gaussian(centre, log_scale):
    """It is shown like any other while its centre is in front of the near plane, and not at all behind it."""
    gaussians = with_values(with_values(aside(), "means", 0, centre), "log_scales", 0, log_scale)
    assert assert_same(gaussians, AHEAD).visible[0] == (centre[2] > 0.01)


def test_a_thousand_gaussians_in_one_pixel():
    gaussians = row_of(np.linspace(4, 5, 1000, dtype=np.float32), logit=-5.0, scale=1e-3, degree=1)
    offset = np.float32(0.5 / 36)  # to the middle of a pixel, at the depth of each
    gaussians.means[:, :2] = offset * gaussians.means[:, 2:]
    state = assert_same(gaussians, AHEAD, gradient_error=1e-3)
    assert state.visible.all()
    assert state.last.max() == 1000


def test_thousands_of_equal_depths_are_blended_in_index_order():
    gaussians = cloud(4000, 0, size=0.05)
    means = gaussians.means.copy()
    means[:, 2] = 4
    gaussians = replace(gaussians, means=means, opacity_logits=gaussians.opacity_logits - 2)
    state = assert_same(gaussians, replace(AHEAD, width=24, height=16, cx=12.0, cy=8.0))
    assert np.array_equal(state.order, np.flatnonzero(state.visible))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_some_with_nothing_finite_leave_the_others_bit_for_bit_alone(value):
    gaussians, view = cloud(2000, 3, seed=5, size=0.05), camera(90, 70)
    non_finite = np.random.default_rng(6).choice(2000, 300, replace=False)
    for name in FIELDS:
        gaussians = with_values(gaussians, name, non_finite, value)
    assert_absent(gaussians, view, non_finite)


@pytest.mark.parametrize("name", FIELDS)
def test_every_kind_of_number_that_is_none_at_once(name):
    gaussians, view = cloud(600, 2, seed=7, size=0.08), camera(70, 50)
    kinds = {"opacity_logits": [np.nan, -np.inf], "log_scales": [np.nan, np.inf]}.get(name, [np.nan, np.inf, -np.inf])
    for first, value in enumerate(kinds):
        gaussians = with_values(gaussians, name, slice(first, 100, len(kinds)), value)
    assert_absent(gaussians, view, np.arange(100))


def flat(value, size=(26, 34)):
    """A picture of one colour."""
    return np.broadcast_to(np.asarray(value, np.float32), (*size, 3)).copy()


PICTURES = {
    "black": flat(0),
    "white": flat(1),
    "grey": flat(0.5),
    "red": flat([1, 0, 0]),
    "nearly black": flat(1e-30),
    "one white pixel": np.where(np.arange(26 * 34).reshape(26, 34, 1) == 400, flat(1), flat(0)),
    "halves": np.where(np.arange(34)[:, None] < 17, flat(0), flat(1)),
}


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("target", PICTURES)
@pytest.mark.parametrize("image", PICTURES)
def test_the_loss_of_flat_pictures(image, target, share):
    x = torch.from_numpy(PICTURES[image]).double().requires_grad_()
    photograph = prepare_target(to_uint8(PICTURES[target]))
    exact = reference.photometric_loss(x, torch.from_numpy(photograph.image).double(), share)
    exact.backward()
    loss, gradient = photometric_loss(PICTURES[image], photograph, share)
    expected = x.grad.numpy()
    assert np.isfinite(gradient).all()
    assert loss == pytest.approx(float(exact.detach()), abs=2e-6)
    assert np.abs(gradient - expected).max() <= 2e-4 * np.abs(expected).max() + 1e-3 / expected.size
