import numpy as np
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.rain_model.kernels import add_mist, mist_gradient
from hydroviews.scene.images import to_linear, to_srgb

SHAPE = 13, 17, 3
COLOUR = np.array([0.7, 0.75, 0.8], np.float32)


@pytest.fixture
def picture():
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, SHAPE).astype(np.float32), rng.uniform(0.05, 0.9, SHAPE[:2]).astype(np.float32)


def exact(image, alpha, colour):
    return to_srgb(to_linear(image) * (1 - alpha[..., None]) + alpha[..., None] * colour)


def test_the_curve_is_that_of_srgb_from_black_to_beyond_white():
    """Decoded and encoded again, and light alone: every value of a picture as to_srgb and to_linear have it."""
    values = np.concatenate([np.linspace(0, 0.08, 3001), np.linspace(0.08, 1.8, 3000)]).astype(np.float32)
    image = np.repeat(values[None, :, None], 3, axis=2)
    for alpha in (1e-6, 0.05, 0.9):
        plane = np.full(image.shape[:2], alpha, np.float32)
        out = add_mist(image, plane, COLOUR, np.empty_like(image)).astype(np.float64)
        wide = image.astype(np.float64)
        light = np.where(wide <= 0.04045, wide / 12.92, ((wide + 0.055) / 1.055) ** 2.4) * (1 - alpha) + alpha * COLOUR
        expected = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        assert np.abs(out - expected).max() < 1e-5


def test_no_mist_leaves_the_very_same_pixels(picture):
    image, alpha = picture
    out = add_mist(image * 3, np.zeros_like(alpha), COLOUR, np.empty_like(image))
    assert np.array_equal(out, image * 3)


def test_gradients_agree_with_differences(picture):
    image, alpha = picture
    image = 0.05 + 0.9 * image  # away from the kink of the curve
    toward = np.random.default_rng(1).standard_normal(SHAPE).astype(np.float32)
    misted = add_mist(image, alpha, COLOUR, np.empty_like(image))
    told = np.random.default_rng(3).standard_normal(SHAPE).astype(np.float32)
    g_image, g_alpha, g_colour = mist_gradient(image, misted, alpha, COLOUR, toward, told, BufferPool())
    step = 1e-3

    def change(toward, **moved):
        values = {"image": image, "alpha": alpha, "colour": COLOUR}
        up = exact(**{**values, **{k: values[k] + step * d for k, d in moved.items()}})
        down = exact(**{**values, **{k: values[k] - step * d for k, d in moved.items()}})
        return float(((up.astype(np.float64) - down) / (2 * step) * toward).sum())

    rng = np.random.default_rng(2)
    for name, gradient, given in (("image", g_image, toward), ("alpha", g_alpha, told), ("colour", g_colour, told)):
        direction = rng.choice([-1.0, 1.0], gradient.shape).astype(np.float32)
        assert change(given, **{name: direction}) == pytest.approx(
            float((gradient * direction).sum()), rel=0.02, abs=0.05
        )


def test_pixels_brighter_than_white_stay_finite():
    image = np.full((2, 2, 3), 9.0, np.float32)
    alpha = np.full((2, 2), 0.5, np.float32)
    out = add_mist(image, alpha, COLOUR, np.empty_like(image))
    g_image, g_alpha, _ = mist_gradient(image, out, alpha, COLOUR, *(2 * [np.ones_like(image)]), BufferPool())
    assert np.isfinite(out).all()
    assert np.isfinite(g_image).all()
    assert np.isfinite(g_alpha).all()
