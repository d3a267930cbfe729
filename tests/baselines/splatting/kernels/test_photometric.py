"""The fused loss and Adam against torch."""

import numba
import numpy as np
import pytest
import torch
from ssim_windows import KINDS, hard_weights, loss_by_windows

from baselines.splatting.backends.torch_rasterizer import photometric_loss as exact_loss
from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import NONE, compare, photometric_loss, prepare_target
from hydroviews.scene.images import to_uint8


def pair(width, height, seed=0):
    """A render and its target [H, W, 3], which has 8 bits."""
    generator = np.random.default_rng(seed)
    target = (np.round(255 * generator.random((height, width, 3))) / np.float32(255)).astype(np.float32)
    return (target + 0.1 * generator.normal(size=target.shape)).astype(np.float32), target


def target_of(picture, ignored=None):
    return prepare_target(to_uint8(picture), ignored)


@pytest.mark.parametrize("size", [(1, 1), (3, 20), (40, 30), (65, 17)])
@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_loss_and_gradient_match_autograd(size, share):
    image, target = pair(*size, seed=1)
    loss, gradient = photometric_loss(image, target_of(target), share)
    x = torch.from_numpy(image).double().requires_grad_()
    exact = exact_loss(x, torch.from_numpy(target).double(), share)
    exact.backward()
    assert loss == pytest.approx(float(exact.detach()), abs=1e-6)
    assert np.abs(gradient - x.grad.numpy()).max() < 2e-5 * np.abs(x.grad.numpy()).max() + 1e-9


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
    ways = [(weights, None), (np.where(hidden, np.float32(3), weights), hidden)]  # what is hidden may weigh anything
    for factors, ignored in [*ways, (None, hidden)] if set(np.unique(weights)) <= {0, 1} else ways:
        loss, gradient = photometric_loss(broken, target_of(target, ignored), 0.2, factors)
        assert loss == pytest.approx(float(exact.detach()), rel=1e-6, abs=1e-7 * float(weights.max()))
        assert np.linalg.norm(gradient - expected) <= tolerance * np.linalg.norm(expected)
        assert not gradient[hidden].any()

        tried = torch.from_numpy(broken).double().requires_grad_()
        given = [value if value is None else torch.from_numpy(value) for value in (ignored, factors)]
        slow = exact_loss(tried, y.double(), 0.2, given[0] if ignored is None else ~given[0], given[1])
        slow.backward()
        assert float(slow.detach()) == pytest.approx(float(exact.detach()), rel=1e-9)
        assert np.linalg.norm(tried.grad.numpy() - expected) <= 1e-9 * np.linalg.norm(expected)


@pytest.mark.parametrize("size", [(133, 161), (7, 400)])
def test_weights_match_autograd_where_parts_meet(size):
    image, target = pair(*size)
    weights = np.random.default_rng(1).random(target.shape[:2]).astype(np.float32)
    x = torch.from_numpy(image).double().requires_grad_()
    exact = exact_loss(x, torch.from_numpy(target).double(), 0.2, None, torch.from_numpy(weights))
    exact.backward()
    loss, gradient = photometric_loss(image, target_of(target), 0.2, weights)
    assert loss == pytest.approx(float(exact.detach()), abs=1e-7)
    assert np.linalg.norm(gradient - x.grad.numpy()) < 2e-6 * np.linalg.norm(x.grad.numpy())


@pytest.mark.parametrize("level", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_constant_pictures_that_are_equal_have_no_loss_whatever_weighs(level, kind):
    """Variances are nothing but rounding there."""
    image = target_of(np.full((30, 21, 3), level, np.float32)).image
    weights = hard_weights(kind, 30, 21)
    loss, gradient = photometric_loss(image, target_of(image), 0.2, weights)
    assert loss == pytest.approx(0, abs=1e-6 * float(weights.max()))
    assert np.abs(gradient).max() <= 1e-6 * weights.max()


@pytest.mark.parametrize("factor", [1e-12, 0.3, 7.0, 1e12])
def test_a_common_factor_on_weights_is_one_on_the_loss(factor):
    image, target = pair(40, 30)
    weights = np.random.default_rng(1).random(target.shape[:2]).astype(np.float32)
    weights[5:20, 10:30] = 0
    loss, gradient = photometric_loss(image, target_of(target), 0.2, weights)
    scaled, by_factor = photometric_loss(image, target_of(target), 0.2, np.float32(factor) * weights)
    assert scaled == pytest.approx(factor * loss, rel=1e-6)
    assert np.linalg.norm(by_factor - factor * gradient) < 1e-5 * factor * np.linalg.norm(gradient)


def test_pixels_beside_hidden_ones_are_compared_as_if_nothing_were_hidden():
    """Two flat pictures stay as alike as they are behind isolated hidden pixels."""
    image, target = np.full((24, 24, 3), 0.6, np.float32), np.full((24, 24, 3), 0.2, np.float32)
    ignored = np.zeros((24, 24), bool)
    ignored[8:16:2, 8:16:3] = True
    whole, losses = loss_map(image, target_of(target)), loss_map(image, target_of(target, ignored))
    deep = np.zeros_like(ignored)
    deep[6:-6, 6:-6] = True  # windows reach over no edge
    assert np.allclose(losses[deep & ~ignored], whole[12, 12], rtol=1e-5)
    assert not losses[ignored].any()


def test_weight_one_is_no_weight_and_zero_is_no_gradient():
    image, target = pair(20, 20)
    plain = photometric_loss(image, target_of(target))
    ones = photometric_loss(image, target_of(target), weights=np.ones((20, 20), np.float32))
    nothing = photometric_loss(image, target_of(target), weights=np.zeros((20, 20), np.float32))
    assert ones[0] == pytest.approx(plain[0], rel=1e-6)
    assert np.linalg.norm(ones[1] - plain[1]) < 1e-6 * np.linalg.norm(plain[1])
    assert nothing[0] == 0
    assert not nothing[1].any()


def test_a_weight_that_rounding_left_below_zero_is_zero():
    image, target = pair(40, 30)
    weights = np.ones(target.shape[:2], np.float32)
    weights[:, :20] = 0
    expected = photometric_loss(image, target_of(target), 0.2, weights)
    found = photometric_loss(image, target_of(target), 0.2, np.where(weights == 0, np.float32(-1e-7), weights))
    assert found[0] == expected[0]
    assert np.array_equal(found[1], expected[1])


def test_a_target_is_as_the_photograph_is_kept():
    pixels = np.random.default_rng(0).integers(0, 256, (9, 7, 3), np.uint8)
    target = prepare_target(pixels)
    assert target.pixels is pixels
    assert np.array_equal(target.image, pixels.astype(np.float32) / np.float32(255))
    assert target.image.dtype == np.float32


# where bands, strips, vectors and groups of rows begin and end
@pytest.mark.parametrize("size", [(1, 400), (400, 1), (127, 162), (128, 161), (129, 160), (133, 321), (261, 7)])
@pytest.mark.parametrize("masked", [False, True])
def test_every_size_matches_autograd(size, masked):
    image, target = pair(*size)
    ignored = np.random.default_rng(2).random(target.shape[:2]) < 0.1 if masked else None
    loss, gradient = photometric_loss(image, target_of(target, ignored), 0.2)
    shown = None if ignored is None else torch.from_numpy(~ignored)
    x = torch.from_numpy(image).double().requires_grad_()
    exact = exact_loss(x, torch.from_numpy(target).double(), 0.2, shown)
    exact.backward()
    expected = x.grad.numpy()
    assert loss == pytest.approx(float(exact.detach()), abs=1e-7)
    assert np.linalg.norm(gradient - expected) < 2e-6 * np.linalg.norm(expected)
    assert np.abs(gradient - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("size", [(1, 1), (129, 161), (150, 40)])
def test_nothing_outside_the_picture_is_read_or_written(size):
    """Pictures in the middle of arrays full of NaN: none gets in, and none is overwritten."""
    height = size[1]
    image, target = pair(*size)
    loss, gradient = photometric_loss(image, target_of(target))

    def surrounded(plane, by=np.nan):
        flat = np.full(plane.size + 4096, by, plane.dtype)
        inside = flat[2048:-2048].reshape(height, -1)
        inside[:] = plane.reshape(height, -1)
        return flat, inside

    (_, x), (around, out) = surrounded(image), surrounded(np.zeros_like(image))
    for by in (0, 255):
        _, y = surrounded(to_uint8(target), by)
        again = compare(x.reshape(image.shape), prepare_target(y.reshape(image.shape)), 0.2, NONE, NONE, out)
        assert again == loss
        assert np.array_equal(out, gradient.reshape(height, -1))
    assert np.isnan(around[:2048]).all()
    assert np.isnan(around[-2048:]).all()


def test_results_do_not_depend_on_the_number_of_threads():
    image, target = pair(300, 330)
    weights = np.random.default_rng(1).random(target.shape[:2]).astype(np.float32)
    results = []
    for threads in (1, 2):
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
        loss, gradient = photometric_loss(image, target_of(target), 0.2, weights)
        results.append((loss, gradient.tobytes()))
    assert results[0] == results[1]


def test_smooth_pictures_lose_little_to_rounding():
    """The variances of smooth pictures are small differences of large means."""
    waves = 0.5 + 0.45 * np.sin(np.arange(120 * 90 * 3).reshape(90, 120, 3) / 40)
    target = np.round(255 * waves).astype(np.float32) / np.float32(255)
    image = (waves + 0.01 * np.random.default_rng(0).normal(size=waves.shape)).astype(np.float32)
    x = torch.from_numpy(image).double().requires_grad_()
    exact_loss(x, torch.from_numpy(target).double(), 1.0).backward()
    error = photometric_loss(image, target_of(target), 1.0)[1] - x.grad.numpy()
    assert np.linalg.norm(error) < 4e-6 * np.linalg.norm(x.grad.numpy())


def test_sizes_must_agree():
    image, target = pair(8, 8)
    with pytest.raises(ValueError, match="differ in size"):
        photometric_loss(image[:-1], target_of(target))
    with pytest.raises(ValueError, match="differ in size"):
        photometric_loss(image, target_of(target), weights=np.ones((7, 8), np.float32))


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
    values, gradient = np.zeros((500, 4, 3), np.float32), np.ones((500, 4, 3), np.float32)
    rates = np.arange(12, dtype=np.float32).reshape(4, 3)
    adam_step(values, gradient, np.zeros_like(values), np.zeros_like(values), 1, rates)
    assert np.allclose(values, -rates[None], rtol=1e-5)


@pytest.fixture
def hidden():
    """A picture [30, 40, 3], a render of it, and a mask with a person-like blob, single pixels and a border."""
    image, target = pair(40, 30)
    ignored = np.zeros((30, 40), bool)
    ignored[5:20, 10:17] = ignored[25, 30] = ignored[:, -2:] = True
    return image, target, ignored


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_what_is_hidden_changes_nothing(hidden, share):
    image, target, ignored = hidden
    loss, gradient = photometric_loss(image, target_of(target, ignored), share)
    gradient = gradient.copy()
    noise = np.random.default_rng(2).random(image.shape).astype(np.float32)
    noise[6, 11] = np.nan
    other_image, other_target = (np.where(ignored[..., None], noise, picture) for picture in (image, target))
    other_target[6, 11] = 1
    again, same = photometric_loss(other_image, target_of(other_target, ignored), share)
    assert loss == again
    assert np.array_equal(gradient, same)
    assert not gradient[ignored].any()
    assert (gradient[~ignored] != 0).mean() > 0.99


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_gradient_beside_hidden_pixels_matches_autograd_and_differences(hidden, share):
    image, target, ignored = hidden
    loss, gradient = photometric_loss(image, target_of(target, ignored), share)
    y, shown = torch.from_numpy(target).double(), torch.from_numpy(~ignored)
    x = torch.from_numpy(image).double().requires_grad_()
    exact = exact_loss(x, y, share, shown)
    exact.backward()
    assert loss == pytest.approx(float(exact.detach()), abs=1e-6)
    assert np.abs(gradient - x.grad.numpy()).max() < 2e-5 * np.abs(x.grad.numpy()).max() + 1e-9
    for row, column in ((4, 12), (12, 17), (25, 29), (10, 37)):  # beside what is hidden
        step = torch.zeros_like(y)
        step[row, column, 1] = 1e-6
        difference = (exact_loss(x + step, y, share, shown) - exact_loss(x - step, y, share, shown)) / 2e-6
        assert gradient[row, column, 1] == pytest.approx(float(difference.detach()), rel=1e-3, abs=1e-8)


def test_a_mask_that_hides_nothing_is_no_mask_and_one_that_hides_all_leaves_no_loss(hidden):
    image, target, ignored = hidden
    plain, gradient = photometric_loss(image, target_of(target))
    gradient = gradient.copy()
    loss, same = photometric_loss(image, target_of(target, np.zeros_like(ignored)))
    assert loss == plain
    assert np.array_equal(gradient, same)
    loss, gradient = photometric_loss(image, target_of(target, np.ones_like(ignored)))
    assert loss == 0
    assert not gradient.any()
    with pytest.raises(ValueError, match="mask"):
        target_of(target, ignored[1:])


def test_weights_and_masks_go_together(hidden):
    image, target, ignored = hidden
    halves = np.full(ignored.shape, 0.5, np.float32)
    loss = photometric_loss(image, target_of(target, ignored))[0]
    assert photometric_loss(image, target_of(target, ignored), weights=halves)[0] == pytest.approx(loss / 2, rel=1e-6)
