"""The kernels against the float64 reference, and hard cases with stated answers."""

from dataclasses import replace

import numba
import numpy as np
import pytest
import torch
from splats import BACKGROUND, camera, cloud, with_values

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import FIELDS, join
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.rasterizer import backward, backward_sh_sets, depth, render, render_sh_sets

WIDTH, HEIGHT = 61, 47


def both(gaussians, view, degree=None, antialiased=False):
    """Image and gradients of a random linear loss, by the kernels and by the reference."""
    degree = gaussians.sh_degree if degree is None else degree
    weights = np.random.default_rng(1).normal(size=(view.height, view.width, 3)).astype(np.float32)
    image, state = render(gaussians, view, BACKGROUND, degree, antialiased=antialiased)
    gradients = backward(state, weights).parameters.state_dict()
    parameters = reference.tensors(gaussians)
    exact = reference.render(parameters, view, torch.from_numpy(BACKGROUND), degree, antialiased=antialiased)
    (exact * torch.from_numpy(weights)).sum().backward()
    return image, gradients, exact.detach().numpy(), {k: v.grad.numpy() for k, v in parameters.items()}


def assert_same(gaussians, view, degree=None, image_error=1e-5, gradient_error=1e-5, antialiased=False):
    image, gradients, exact, exact_gradients = both(gaussians, view, degree, antialiased)
    assert np.abs(image - exact).max() <= image_error
    for name in FIELDS:
        error = np.linalg.norm(gradients[name] - exact_gradients[name])
        assert error <= gradient_error * np.linalg.norm(exact_gradients[name]) + 1e-12, name


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_image_and_gradients_match_the_reference(degree):
    assert_same(cloud(200, degree, seed=degree), camera(WIDTH, HEIGHT))


def test_a_lower_degree_than_stored_leaves_the_rest_alone():
    gaussians = cloud(50, 3)
    _, gradients, _, _ = both(gaussians, camera(WIDTH, HEIGHT), degree=1)
    assert not gradients["sh"][:, 4:].any()
    assert gradients["sh"][:, :4].any()
    assert_same(gaussians, camera(WIDTH, HEIGHT), degree=1)


@pytest.mark.parametrize("size", [0.12, 0.01, 0.002])
def test_antialiased_image_and_gradients_match_the_reference(size):
    assert_same(cloud(300, 1, seed=4, size=size), camera(WIDTH, HEIGHT), antialiased=True)


def test_antialiased_needles():
    """A width of a few hundredths of a pixel: the determinant's entries cancel to one part in 10^8."""
    gaussians = cloud(40, 0, seed=5)
    gaussians.log_scales[:] = np.log([2.0, 1e-3, 1e-3])
    gaussians.opacity_logits[:] = 4
    assert_same(gaussians, camera(WIDTH, HEIGHT), antialiased=True)


def test_antialiasing_keeps_what_a_small_gaussian_adds_to_the_image():
    """Widened to a pixel or not, it brings the same light; without, twice as far away it would bring as much."""
    one = cloud(1, 0, seed=6)
    one = replace(one, means=np.zeros((1, 3), np.float32), sh=np.ones((1, 1, 3), np.float32))
    one.log_scales[:] = np.log(0.02)  # a quarter of a pixel
    one.opacity_logits[:] = 5
    sums = {}
    for antialiased in (False, True):
        for factor in (1, 2):
            view = camera(WIDTH * factor, HEIGHT * factor)
            image, _ = render(one, view, antialiased=antialiased)
            sums[antialiased, factor] = image.sum() / factor**2
    assert sums[True, 1] == pytest.approx(sums[True, 2], rel=0.1)
    assert sums[False, 1] > 2 * sums[False, 2]


def test_given_colours_and_their_gradient():
    gaussians = cloud(100, 3, seed=2)
    colours = np.random.default_rng(3).uniform(0.05, 1, (100, 3)).astype(np.float32)
    weights = np.random.default_rng(1).normal(size=(HEIGHT, WIDTH, 3)).astype(np.float32)
    image, state = render(gaussians.coloured(colours), camera(WIDTH, HEIGHT), BACKGROUND)
    gradient = backward(state, weights).colours.copy()
    parameters = reference.tensors(gaussians.coloured(colours))
    exact = reference.render(parameters, camera(WIDTH, HEIGHT), torch.from_numpy(BACKGROUND), 0)
    assert np.abs(image - exact.detach().numpy()).max() < 1e-5
    step = np.random.default_rng(4).normal(size=colours.shape).astype(np.float32) * 1e-3
    moved, _ = render(gaussians.coloured(colours + step), camera(WIDTH, HEIGHT), BACKGROUND)
    # the image is linear in the colours
    assert np.sum((moved - image) * weights) == pytest.approx(np.sum(gradient * step), rel=1e-2)


def test_depth_is_the_mean_of_what_a_pixel_shows():
    view = camera(WIDTH, HEIGHT)
    gaussians = cloud(60, 0, seed=7)
    _, state = render(gaussians, view, BACKGROUND)
    covered = 1 - state.transmittance
    found = depth(state)
    local = gaussians.means @ view.rotation.T + view.world_to_camera[:3, 3]
    z = local[:, 2].astype(np.float32)
    as_colour, _ = render(gaussians.coloured(np.repeat(z[:, None], 3, axis=1)), view)
    assert np.array_equal(np.isnan(found), covered == 0)
    assert np.allclose(np.nan_to_num(found) * covered, as_colour[..., 0], atol=1e-4)
    assert np.nanmin(found) >= z.min() - 1e-4
    assert np.nanmax(found) <= z.max() + 1e-4
    nothing = gaussians.select(np.arange(0))
    assert np.isnan(depth(render(nothing, view)[1])).all()


def test_every_gaussian_gets_its_own_gradient_right():
    _, gradients, _, exact_gradients = both(cloud(200, 2, seed=9), camera(WIDTH, HEIGHT))
    for name in FIELDS:
        ours, theirs = (g[name].reshape(200, -1) for g in (gradients, exact_gradients))
        size = np.linalg.norm(theirs, axis=1)
        error = np.linalg.norm(ours - theirs, axis=1)[size > 1e-3 * size.max()] / size[size > 1e-3 * size.max()]
        assert np.median(error) < 5e-6
        assert error.max() < 2e-3, name


def test_the_result_does_not_depend_on_the_number_of_threads():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads")
    gaussians, view = cloud(500, 3), camera(120, 90)
    results = []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            image, state = render(gaussians, view, BACKGROUND)
            gradients = backward(state, np.sin(np.arange(image.size, dtype=np.float32)).reshape(image.shape))
            results.append([image, gradients.means2d, *gradients.parameters.state_dict().values()])
    finally:
        numba.set_num_threads(before)
    for one, two in zip(*results, strict=True):
        assert one.tobytes() == two.tobytes()


def test_reused_buffers_change_nothing():
    buffers = BufferPool()
    for n, size in ((300, 60), (40, 30), (200, 80)):
        gaussians, view = cloud(n, 2, seed=n), camera(size, size - 7)
        image, state = render(gaussians, view, BACKGROUND, buffers=buffers)
        again, fresh = render(gaussians, view, BACKGROUND)
        assert np.array_equal(image, again)
        weights = np.ones_like(image)
        ours, theirs = backward(state, weights), backward(fresh, weights)
        assert all(np.array_equal(getattr(ours.parameters, k), getattr(theirs.parameters, k)) for k in FIELDS)


def test_gradient_by_the_position_on_the_image():
    gaussians, view = cloud(80, 0), camera(WIDTH, HEIGHT)
    weights = np.random.default_rng(0).normal(size=(HEIGHT, WIDTH, 3)).astype(np.float32)
    _, state = render(gaussians, view, BACKGROUND)
    shift = torch.zeros(80, 2, dtype=torch.float64, requires_grad=True)
    image = reference.render(reference.tensors(gaussians), view, torch.from_numpy(BACKGROUND), 0, shift=shift)
    (image * torch.from_numpy(weights)).sum().backward()
    exact = shift.grad.numpy()
    assert np.linalg.norm(backward(state, weights).means2d - exact) < 1e-5 * np.linalg.norm(exact)


def test_absolute_gradient_by_the_position_on_the_image():
    """One pixel at a time, so that nothing cancels in the reference either."""
    gaussians, view = cloud(30, 0, size=0.4), camera(7, 5)
    weights = np.random.default_rng(0).normal(size=(5, 7, 3)).astype(np.float32)
    _, state = render(gaussians, view, BACKGROUND)
    shift = torch.zeros(30, 2, dtype=torch.float64, requires_grad=True)
    image = reference.render(reference.tensors(gaussians), view, torch.from_numpy(BACKGROUND), 0, shift=shift)
    pixels = (image * torch.from_numpy(weights)).sum(dim=2).reshape(-1)
    exact = sum(torch.autograd.grad(p, shift, retain_graph=True)[0].abs() for p in pixels).numpy()
    assert np.linalg.norm(backward(state, weights).means2d_absolute - exact) < 1e-5 * np.linalg.norm(exact)


@pytest.mark.parametrize("sets", [1, 2, 3])
def test_sets_of_colours_at_once_are_those_one_by_one(sets):
    clouds, view = [cloud(200, 1, seed=6 + k) for k in range(sets)], camera(WIDTH, HEIGHT)
    gaussians, sh = clouds[0], np.stack([each.sh for each in clouds])
    weights = np.random.default_rng(1).normal(size=(sets, HEIGHT, WIDTH, 3)).astype(np.float32)
    images, state = render_sh_sets(gaussians, sh, view, BACKGROUND)
    gradients, by_sh_sets = backward_sh_sets(state, weights)
    total, absolute = gaussians.zeros().state_dict(), 0
    for k in range(sets):
        image, alone = render(replace(gaussians, sh=sh[k]), view, BACKGROUND)
        part = backward(alone, weights[k])
        assert np.array_equal(images[k], image)
        assert np.allclose(by_sh_sets[k], part.parameters.sh, rtol=1e-4, atol=1e-5)
        total = {name: total[name] + value for name, value in part.parameters.state_dict().items()}
        absolute = absolute + part.means2d_absolute
    for name in ("means", "quaternions", "log_scales", "opacity_logits"):
        found = getattr(gradients.parameters, name)
        assert np.linalg.norm(found - total[name]) < 1e-5 * np.linalg.norm(total[name]), name
    assert (gradients.means2d_absolute <= absolute + 1e-3).all()  # of the sum, not the sum of each set's


def test_looks_of_other_gaussians():
    gaussians = cloud(20, 1)
    with pytest.raises(ValueError, match=r"\(2, 19, 4, 3\) of 20 Gaussians"):
        render_sh_sets(gaussians, np.zeros((2, 19, 4, 3), np.float32), camera(WIDTH, HEIGHT))


# --- hard cases -------------------------------------------------------------------------------------------------------


def in_front(distances):
    """Positions at these distances along the optical axis."""
    view = camera(WIDTH, HEIGHT)
    return (view.centre + np.outer(distances, view.rotation[2])).astype(np.float32)


@pytest.mark.parametrize("length", [1e-10, 1e18])
def test_quaternions_of_any_length(length):
    gaussians = cloud(40, 1)
    scaled = with_values(gaussians, "quaternions", 0, gaussians.quaternions[0] * np.float32(length))
    images = [render(g, camera(WIDTH, HEIGHT), BACKGROUND)[0] for g in (gaussians, scaled)]
    assert np.abs(images[0] - images[1]).max() < 1e-6


@pytest.mark.parametrize("n", [0, 20])
def test_nothing_to_see_is_background_with_zero_gradients(n):
    gaussians = replace(cloud(n, 1), means=np.tile(in_front([-5.0]), (n, 1)))
    image, state = render(gaussians, camera(WIDTH, HEIGHT), BACKGROUND)
    assert np.array_equal(image, np.broadcast_to(BACKGROUND, image.shape))
    gradients = backward(state, np.ones_like(image))
    assert not any(value.any() for value in gradients.parameters.state_dict().values())
    assert gradients.means2d.shape == (n, 2)


@pytest.mark.parametrize("size", [(1, 1), (17, 15), (15, 17), (16, 16), (33, 1)])
def test_image_sizes(size):
    assert_same(cloud(60, 1, seed=2, size=0.4), camera(*size))


def test_a_degree_the_gaussians_do_not_hold_is_refused():
    with pytest.raises(ValueError, match="degree 2"):
        render(cloud(3, 1), camera(8, 8), sh_degree=2)


def test_gaussians_check_their_shapes():
    gaussians = cloud(4, 1)
    with pytest.raises(ValueError, match="log_scales"):
        replace(gaussians, log_scales=np.zeros((3, 3), np.float32))
    with pytest.raises(ValueError, match="coefficients"):
        replace(gaussians, sh=np.zeros((4, 5, 3), np.float32))
    with pytest.raises(ValueError, match="origins"):
        join(gaussians, np.arange(2), replace(gaussians, origin=np.ones(3)))
    joined = join(gaussians, np.array([1, 0]), gaussians)
    assert np.array_equal(joined.means, np.concatenate([gaussians.means[[1, 0]], gaussians.means]))
