"""The unreduced loss and the network's parts, each against a slow or closed form."""

import numpy as np
import pytest
import torch

from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import prepare_target
from deraings.masks.network import MaskNetwork, high_pass, spectral_pooling
from hydroviews.metrics.ssim import ssim_map
from hydroviews.scene.images import to_uint8


def pictures(seed=0, height=23, width=31):
    rng = np.random.default_rng(seed)
    target = np.round(255 * rng.random((height, width, 3), np.float32)) / np.float32(255)
    return np.clip(target + rng.normal(0, 0.1, target.shape), 0, 1).astype(np.float32), target


def target_of(picture, ignored=None):
    return prepare_target(to_uint8(picture), ignored)


def test_the_map_is_l1_and_ssim_of_each_pixel():
    image, target = pictures()
    a, b = (
        torch.from_numpy(np.pad(x, ((5, 5), (5, 5), (0, 0)))).double().permute(2, 0, 1)[None] for x in (image, target)
    )
    similarity = ssim_map(a, b)[0].mean(dim=0).numpy()
    expected = 0.8 * np.abs(image - target).mean(axis=2) + 0.2 * (1 - similarity)
    assert np.abs(loss_map(image, target_of(target)) - expected).max() < 1e-4


def test_hidden_pixels_have_no_loss_and_leave_no_trace():
    image, target = pictures()
    ignored = np.zeros(image.shape[:2], bool)
    ignored[4:15, 6:20] = True
    spoilt = np.where(ignored[..., None], np.float32(np.nan), image)
    found = loss_map(image, target_of(target, ignored)).copy()
    assert (found[ignored] == 0).all()
    assert np.array_equal(found, loss_map(spoilt, target_of(target, ignored)))


@pytest.mark.parametrize("shape", [(16, 20), (15, 21), (1, 7), (9, 1)])
@pytest.mark.parametrize("cutoff", [0.0, 0.125, 0.3])
def test_spectral_pooling_is_the_rms_of_the_high_passed_map(shape, cutoff):
    features = torch.randn(2, 3, *shape, generator=torch.Generator().manual_seed(0))
    spectrum = torch.fft.rfft2(features) * high_pass(*shape, cutoff)
    passed = torch.fft.irfft2(spectrum, s=shape)
    assert passed.mean(dim=(2, 3)).abs().max() < 1e-6  # so the mean would tell nothing
    expected = (passed**2).mean(dim=(2, 3)).sqrt()
    assert torch.allclose(spectral_pooling(features, cutoff), expected, atol=2e-6)


@pytest.mark.parametrize("attention", [True, False])
def test_every_weight_learns(attention):
    """From one of several starts: in a network as narrow as this a rectifier may shut all of a layer off."""
    picture = torch.rand(1, 3, 66, 70, generator=torch.Generator().manual_seed(0))
    silent = []
    for seed in range(4):
        torch.manual_seed(seed)
        network = MaskNetwork(shrink=2, fine=1, width=8, cutoff=0.125, attention=attention)
        assert any("mlp" in name for name, _ in network.named_parameters()) == attention
        descent = torch.optim.SGD(network.parameters(), 0.1)
        for _ in range(2):  # the last layer starts at zero and lets nothing through at first
            descent.zero_grad()
            (network(picture) * picture[:, :1, ::2, ::2]).sum().backward()
            descent.step()
        silent.append({name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0})
    assert set.intersection(*silent) == set()
