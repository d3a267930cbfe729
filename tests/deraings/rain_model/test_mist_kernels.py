import numpy as np
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.rain_model.mist_kernels import veiled, veiled_gradient
from hydroviews.scene.images import to_linear, to_srgb

SHAPE = 13, 17, 3
COLOUR = np.array([0.7, 0.75, 0.8], np.float32)


@pytest.fixture
def picture():
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, SHAPE).astype(np.float32), rng.uniform(0.05, 0.9, SHAPE[:2]).astype(np.float32)


def exact(image, share, colour):
    return to_srgb(to_linear(image) * (1 - share[..., None]) + share[..., None] * colour)


def test_a_veil_is_mixed_in_linear_light(picture):
    image, share = picture
    assert np.abs(veiled(image, share, COLOUR, BufferPool()) - exact(image, share, COLOUR)).max() < 1e-5


def test_no_veil_leaves_the_very_same_pixels(picture):
    image, share = picture
    out = veiled(image * 3, np.zeros_like(share), COLOUR, BufferPool())
    assert np.array_equal(out, image * 3)


def test_gradients_agree_with_differences(picture):
    image, share = picture
    image = 0.05 + 0.9 * image  # away from the kink of the curve
    toward = np.random.default_rng(1).standard_normal(SHAPE).astype(np.float32)
    buffers = BufferPool()
    g_image, g_share, g_colour = veiled_gradient(image, share, COLOUR, toward, buffers)
    step = 1e-3

    def change(**moved):
        values = {"image": image, "share": share, "colour": COLOUR}
        up = exact(**{**values, **{k: values[k] + step * d for k, d in moved.items()}})
        down = exact(**{**values, **{k: values[k] - step * d for k, d in moved.items()}})
        return float(((up.astype(np.float64) - down) / (2 * step) * toward).sum())

    rng = np.random.default_rng(2)
    for name, gradient in (("image", g_image), ("share", g_share), ("colour", g_colour)):
        direction = rng.choice([-1.0, 1.0], gradient.shape).astype(np.float32)
        assert change(**{name: direction}) == pytest.approx(float((gradient * direction).sum()), rel=0.02, abs=0.05)


def test_pixels_brighter_than_white_stay_finite():
    image = np.full((2, 2, 3), 9.0, np.float32)
    share = np.full((2, 2), 0.5, np.float32)
    out = veiled(image, share, COLOUR, BufferPool())
    g_image, g_share, _ = veiled_gradient(image, share, COLOUR, np.ones_like(image), BufferPool())
    assert np.isfinite(out).all()
    assert np.isfinite(g_image).all()
    assert np.isfinite(g_share).all()
