"""The kernels against the float64 reference, and what a render promises besides."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from against_float64 import assert_same, random_weights, rendered
from splats import BACKGROUND, camera, cloud, with_values
from thread_counts import assert_same_on_two_threads

from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.gaussians import FIELDS, join
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.rasterizer import backward, backward_sh_sets, depth, render, render_sh_sets

WIDTH, HEIGHT = 61, 47
VIEW = camera(WIDTH, HEIGHT)


def needles():
    """A width of a few hundredths of a pixel: the determinant's entries cancel to one part in 10^8."""
    gaussians = with_values(cloud(40, 0, seed=5), "log_scales", slice(None), np.log([2.0, 1e-3, 1e-3]))
    return with_values(gaussians, "opacity_logits", slice(None), 4)


@pytest.mark.parametrize(
    ("gaussians", "view", "options"),
    [
        *(pytest.param(cloud(200, degree, seed=degree), VIEW, {}, id=f"degree {degree}") for degree in range(4)),
        pytest.param(cloud(50, 3), VIEW, {"sh_degree": 1}, id="a lower degree than stored"),
        *(
            pytest.param(cloud(300, 1, seed=4, size=size), VIEW, {"antialiased": True}, id=f"antialiased, {size}")
            for size in (0.12, 0.01, 0.002)
        ),
        pytest.param(needles(), VIEW, {"antialiased": True}, id="antialiased needles"),
        *(
            pytest.param(cloud(60, 1, seed=2, size=0.4), camera(*size), {}, id=f"image of {size}")
            for size in ((1, 1), (17, 15), (15, 17), (16, 16), (33, 1))
        ),
    ],
)
def test_image_and_gradients_match_the_reference(gaussians, view, options):
    assert_same(gaussians, view, **options)


def test_antialiasing_keeps_what_a_small_gaussian_adds_to_the_image():
    """Widened to a pixel or not, it brings the same light; without, twice as far away it would bring as much."""
    one = with_values(with_values(cloud(1, 0, seed=6), "means", 0, 0), "sh", 0, 1)
    one = with_values(with_values(one, "log_scales", 0, np.log(0.02)), "opacity_logits", 0, 5)  # a quarter of a pixel

    def light(antialiased, factor):
        view = camera(WIDTH * factor, HEIGHT * factor)
        return render(one, view, antialiased=antialiased)[0].sum() / factor**2

    assert light(True, 1) == pytest.approx(light(True, 2), rel=0.1)
    assert light(False, 1) > 2 * light(False, 2)


def test_given_colours_and_their_gradient():
    gaussians, generator = cloud(100, 3, seed=2), np.random.default_rng(3)
    colours = generator.uniform(0.05, 1, (100, 3)).astype(np.float32)
    weights = random_weights(HEIGHT, WIDTH)
    image, state = render(gaussians.coloured(colours), VIEW, BACKGROUND)
    gradient = backward(state, weights).colours.copy()
    exact = reference.render(reference.tensors(gaussians.coloured(colours)), VIEW, torch.from_numpy(BACKGROUND), 0)
    assert np.abs(image - exact.detach().numpy()).max() < 1e-5
    step = 1e-3 * generator.normal(size=colours.shape).astype(np.float32)
    moved, _ = render(gaussians.coloured(colours + step), VIEW, BACKGROUND)  # the image is linear in the colours
    assert np.sum((moved - image) * weights) == pytest.approx(np.sum(gradient * step), rel=1e-2)


def test_depth_is_the_mean_of_what_a_pixel_shows():
    gaussians = cloud(60, 0, seed=7)
    _, state = render(gaussians, VIEW, BACKGROUND)
    covered, found = 1 - state.transmittance, depth(state)
    z = (gaussians.means @ VIEW.rotation.T + VIEW.world_to_camera[:3, 3])[:, 2].astype(np.float32)
    as_colour, _ = render(gaussians.coloured(np.repeat(z[:, None], 3, axis=1)), VIEW)
    assert np.array_equal(np.isnan(found), covered == 0)
    assert np.allclose(np.nan_to_num(found) * covered, as_colour[..., 0], atol=1e-4)


def test_the_result_does_not_depend_on_the_number_of_threads():
    def drawn():
        image, _, gradients = rendered(cloud(500, 3), camera(120, 90))
        return image, *gradients.values()

    assert_same_on_two_threads(drawn)


def test_reused_buffers_change_nothing():
    buffers = BufferPool()
    for n, size in ((300, 60), (40, 30), (200, 80)):
        gaussians, view = cloud(n, 2, seed=n), camera(size, size - 7)
        image, _, gradients = rendered(gaussians, view, buffers=buffers)
        fresh, _, expected = rendered(gaussians, view)
        assert np.array_equal(image, fresh)
        for name in FIELDS:
            assert np.array_equal(gradients[name], expected[name]), name


def shifted(gaussians, view):
    """Shifts of splats on the image [N, 2], zero, and the reference's image, which depends on them."""
    shift = torch.zeros(len(gaussians), 2, dtype=torch.float64, requires_grad=True)
    background = torch.from_numpy(BACKGROUND)
    return shift, reference.render(reference.tensors(gaussians), view, background, 0, shift=shift)


def test_gradient_by_the_position_on_the_image():
    gaussians, weights = cloud(80, 0), random_weights(HEIGHT, WIDTH)
    shift, image = shifted(gaussians, VIEW)
    (image * torch.from_numpy(weights)).sum().backward()
    found = backward(render(gaussians, VIEW, BACKGROUND)[1], weights).means2d
    assert np.linalg.norm(found - shift.grad.numpy()) < 1e-5 * np.linalg.norm(shift.grad.numpy())


def test_absolute_gradient_by_the_position_on_the_image():
    """One pixel at a time, so that nothing cancels in the reference either."""
    gaussians, view, weights = cloud(30, 0, size=0.4), camera(7, 5), random_weights(5, 7)
    shift, image = shifted(gaussians, view)
    pixels = (image * torch.from_numpy(weights)).sum(dim=2).reshape(-1)
    exact = sum(torch.autograd.grad(pixel, shift, retain_graph=True)[0].abs() for pixel in pixels).numpy()
    found = backward(render(gaussians, view, BACKGROUND)[1], weights).means2d_absolute
    assert np.linalg.norm(found - exact) < 1e-5 * np.linalg.norm(exact)


@pytest.mark.parametrize("sets", [1, 2, 3])
def test_sets_of_colours_at_once_are_those_one_by_one(sets):
    clouds = [cloud(200, 1, seed=6 + k) for k in range(sets)]
    gaussians, sh = clouds[0], np.stack([each.sh for each in clouds])
    weights = [random_weights(HEIGHT, WIDTH, seed=k) for k in range(sets)]
    images, state = render_sh_sets(gaussians, sh, VIEW, BACKGROUND)
    gradients, by_sh_sets = backward_sh_sets(state, np.stack(weights))
    parts = []
    for k in range(sets):
        image, alone = render(replace(gaussians, sh=sh[k]), VIEW, BACKGROUND)
        parts.append(backward(alone, weights[k]))
        assert np.array_equal(images[k], image)
        assert np.allclose(by_sh_sets[k], parts[k].parameters.sh, rtol=1e-4, atol=1e-5)
    for name in ("means", "quaternions", "log_scales", "opacity_logits"):
        found, total = getattr(gradients.parameters, name), sum(getattr(part.parameters, name) for part in parts)
        assert np.linalg.norm(found - total) < 1e-5 * np.linalg.norm(total), name
    absolute = sum(part.means2d_absolute for part in parts)
    assert (gradients.means2d_absolute <= absolute + 1e-3).all()  # of the sum, not the sum of each set's


@pytest.mark.parametrize("n", [0, 20])
def test_nothing_to_see_is_background_with_zero_gradients(n):
    behind = (VIEW.centre - 5 * VIEW.rotation[2]).astype(np.float32)
    gaussians = replace(cloud(n, 1), means=np.tile(behind, (n, 1)))
    image, state, gradients = rendered(gaussians, VIEW)
    assert np.array_equal(image, np.broadcast_to(BACKGROUND, image.shape))
    assert not any(value.any() for value in gradients.values())
    assert np.isnan(depth(state)).all()


def test_arrays_that_do_not_fit_are_refused():
    gaussians = cloud(4, 1)
    with pytest.raises(ValueError, match="degree 2"):
        render(gaussians, camera(8, 8), sh_degree=2)
    with pytest.raises(ValueError, match=r"\(2, 3, 4, 3\) of 4 Gaussians"):
        render_sh_sets(gaussians, np.zeros((2, 3, 4, 3), np.float32), VIEW)
    with pytest.raises(ValueError, match="log_scales"):
        replace(gaussians, log_scales=np.zeros((3, 3), np.float32))
    with pytest.raises(ValueError, match="coefficients"):
        replace(gaussians, sh=np.zeros((4, 5, 3), np.float32))
    with pytest.raises(ValueError, match="origins"):
        join(gaussians, np.arange(2), replace(gaussians, origin=np.ones(3)))
