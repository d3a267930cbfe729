"""The fused loss and Adam against torch."""

import numpy as np
import pytest
import torch
from ssim_windows import KINDS, hard_weights, loss_by_windows
from thread_counts import assert_same_on_two_threads

from baselines.splatting.backends.torch_rasterizer import photometric_loss as exact_loss
from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.photometric import NONE, compare, photometric_loss, prepare_target
from hydroviews.scene.images import to_uint8

SHARES = (0.0, 0.2, 1.0)


def pair(width, height, seed=0):
    """A render and its target [H, W, 3], which has 8 bits."""
    generator = np.random.default_rng(seed)
    target = (np.round(255 * generator.random((height, width, 3))) / np.float32(255)).astype(np.float32)
    return (target + 0.1 * generator.normal(size=target.shape)).astype(np.float32), target


def target_of(picture, ignored=None):
    return prepare_target(to_uint8(picture), ignored)


def exactly(image, target, share, ignored=None, weights=None):
    """Loss and gradient in float64."""
    x = torch.from_numpy(image).double().requires_grad_()
    shown = None if ignored is None else torch.from_numpy(~ignored)
    given = None if weights is None else torch.from_numpy(weights)
    loss = exact_loss(x, torch.from_numpy(target).double(), share, shown, given)
    loss.backward()
    return float(loss.detach()), x.grad.numpy()


# where bands, strips, vectors and groups of rows begin and end
LARGE = (1, 400), (400, 1), (127, 162), (128, 161), (129, 160), (133, 321), (261, 7)


@pytest.mark.parametrize(
    ("size", "share"),
    [*((size, 0.2) for size in LARGE), *((size, share) for size in ((1, 1), (3, 20), (40, 30)) for share in SHARES)],
)
@pytest.mark.parametrize("kind", ["plain", "masked", "weighted"])
def test_loss_and_gradient_match_autograd(size, share, kind):
    image, target = pair(*size)
    plane = np.random.default_rng(2).random(target.shape[:2]).astype(np.float32)
    ignored, weights = plane < 0.1 if kind == "masked" else None, plane if kind == "weighted" else None
    loss, gradient = photometric_loss(image, target_of(target, ignored), share, weights)
    exact, expected = exactly(image, target, share, ignored, weights)
    tolerance = 1 if size in LARGE else 10  # few windows do not average out what rounding leaves of their variances
    assert loss == pytest.approx(exact, abs=2e-7 * tolerance)
    assert np.linalg.norm(gradient - expected) < 2e-6 * tolerance * np.linalg.norm(expected) + 1e-9


@pytest.mark.parametrize("size", [(1, 1), (4, 3), (27, 22)])
@pytest.mark.parametrize("kind", KINDS)
def test_windows_weigh_pixels_as_the_loss_does(size, kind):
    """Against every window spelled out in float64, with NaN wherever a pixel counts for nothing."""
    image, target = pair(*size, seed=2)
    weights = hard_weights(kind, *target.shape[:2])
    x, y = torch.from_numpy(image).double().requires_grad_(), torch.from_numpy(target)
    exact = loss_by_windows(x, y, 0.2, torch.from_numpy(weights))
    exact.backward()
    expected, hidden = x.grad.numpy(), weights == 0
    tolerance = 5e-5 if kind == "one pixel" else 5e-6  # alone in its window, whose variance is nothing but rounding
    broken = np.where(hidden[..., None], np.float32(np.nan), image)
    below = np.where(hidden, np.float32(-1e-7), weights)  # as rounding may leave a weight of zero
    ways = [(weights, None), (below, None), (np.where(hidden, np.float32(3), weights), hidden)]
    for factors, ignored in [*ways, (None, hidden)] if set(np.unique(weights)) <= {0, 1} else ways:
        loss, gradient = photometric_loss(broken, target_of(target, ignored), 0.2, factors)
        assert loss == pytest.approx(float(exact.detach()), rel=1e-6, abs=1e-7 * float(weights.max()))
        assert np.linalg.norm(gradient - expected) <= tolerance * np.linalg.norm(expected)
        assert not gradient[hidden].any()
        slow, slow_gradient = exactly(broken, target, 0.2, ignored, factors)
        assert slow == pytest.approx(float(exact.detach()), rel=1e-9)
        assert np.linalg.norm(slow_gradient - expected) <= 1e-9 * np.linalg.norm(expected)


@pytest.mark.parametrize("level", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_constant_pictures_that_are_equal_have_no_loss_whatever_weighs(level, kind):
    """Variances are nothing but rounding there."""
    image = target_of(np.full((30, 21, 3), level, np.float32)).image
    weights = hard_weights(kind, 30, 21)
    loss, gradient = photometric_loss(image, target_of(image), 0.2, weights)
    assert loss == pytest.approx(0, abs=1e-6 * float(weights.max()))
    assert np.abs(gradient).max() <= 1e-6 * weights.max()


def flat(value):
    """A picture of one colour."""
    return np.broadcast_to(np.asarray(value, np.float32), (26, 34, 3)).copy()


PICTURES = {
    "black": flat(0),
    "white": flat(1),
    "grey": flat(0.5),
    "red": flat([1, 0, 0]),
    "nearly black": flat(1e-30),
    "one white pixel": np.where(np.arange(26 * 34).reshape(26, 34, 1) == 400, flat(1), flat(0)),
    "halves": np.where(np.arange(34)[:, None] < 17, flat(0), flat(1)),
}


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("target", PICTURES)
@pytest.mark.parametrize("image", PICTURES)
def test_flat_pictures_match_autograd(image, target, share):
    photograph = target_of(PICTURES[target])
    loss, gradient = photometric_loss(PICTURES[image], photograph, share)
    exact, expected = exactly(PICTURES[image], photograph.image, share)
    assert loss == pytest.approx(exact, abs=2e-6)
    assert np.abs(gradient - expected).max() <= 2e-4 * np.abs(expected).max() + 1e-3 / expected.size


def test_smooth_pictures_lose_little_to_rounding():
    """The variances of smooth pictures are small differences of large means."""
    waves = 0.5 + 0.45 * np.sin(np.arange(120 * 90 * 3).reshape(90, 120, 3) / 40)
    target = np.round(255 * waves).astype(np.float32) / np.float32(255)
    image = (waves + 0.01 * np.random.default_rng(0).normal(size=waves.shape)).astype(np.float32)
    _, expected = exactly(image, target, 1.0)
    error = photometric_loss(image, target_of(target), 1.0)[1] - expected
    assert np.linalg.norm(error) < 4e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize("size", [(1, 1), (129, 161), (150, 40)])
def test_nothing_outside_the_picture_is_read_or_written(size):
    """Pictures in the middle of arrays full of NaN: none gets in, and none is overwritten."""
    image, target = pair(*size)
    loss, gradient = photometric_loss(image, target_of(target))

    def surrounded(plane, by=np.nan):
        around = np.full(plane.size + 4096, by, plane.dtype)
        inside = around[2048:-2048].reshape(plane.shape)
        inside[:] = plane
        return around, inside

    (_, x), (around, out) = surrounded(image), surrounded(np.zeros_like(image))
    rows = out.reshape(len(out), -1)
    for by in (0, 255):
        _, y = surrounded(to_uint8(target), by)
        assert compare(x, prepare_target(y), 0.2, NONE, NONE, rows) == loss
        assert np.array_equal(out, gradient)
    assert np.isnan(around[:2048]).all()
    assert np.isnan(around[-2048:]).all()


def test_results_do_not_depend_on_the_number_of_threads():
    image, target = pair(300, 330)
    weights = np.random.default_rng(1).random(target.shape[:2]).astype(np.float32)
    assert_same_on_two_threads(lambda: photometric_loss(image, target_of(target), 0.2, weights))


def test_sizes_must_agree():
    image, target = pair(8, 8)
    with pytest.raises(ValueError, match="differ in size"):
        photometric_loss(image[:-1], target_of(target))
    with pytest.raises(ValueError, match="differ in size"):
        photometric_loss(image, target_of(target), weights=np.ones((7, 8), np.float32))
    with pytest.raises(ValueError, match="mask"):
        target_of(target, np.zeros((7, 8), bool))


@pytest.mark.parametrize("shape", [(1,), (1000, 3), (700, 16, 3), (0, 3)])
def test_adam_is_torchs(shape):
    generator = np.random.default_rng(0)
    ours = generator.normal(size=shape).astype(np.float32)
    theirs = torch.from_numpy(ours.copy()).requires_grad_()
    optimiser = torch.optim.Adam([theirs], lr=1e-2, eps=1e-15)
    first, second = np.zeros_like(ours), np.zeros_like(ours)
    for step in range(1, 8):
        gradient = generator.normal(size=shape).astype(np.float32)
        theirs.grad = torch.from_numpy(gradient.copy())
        optimiser.step()
        adam_step(ours, gradient, first, second, step, 1e-2)
    assert np.allclose(ours, theirs.detach().numpy(), rtol=1e-5, atol=1e-6)


def test_adam_takes_a_rate_for_each_column():
    values, gradient, first, second = np.zeros((4, 500, 4, 3), np.float32)
    rates = np.arange(12, dtype=np.float32).reshape(4, 3)
    adam_step(values, gradient + 1, first, second, 1, rates)
    assert np.allclose(values, -rates[None], rtol=1e-5)
