import numpy as np
import pytest
import torch

from baselines.masking.feature_network import MaskNetwork, MaskNetworkConfig, averaged, encoded_places, hinge
from baselines.training.images import TrainingImages

CONFIG = MaskNetworkConfig("vgg", rate=2e-2)


def blocks(image):
    """Mean colours of 8x8 pixels, and a constant."""
    planes = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)
    mean = torch.nn.functional.avg_pool2d(planes, 8)
    return torch.cat([mean, torch.full_like(mean[:1], 0.7)])


def photographs(n=4):
    """Noise, in the left upper quarter of every other one a red square."""
    pixels = np.random.default_rng(0).integers(60, 120, (n, 32, 48, 3)).astype(np.uint8)
    pixels[::2, :16, :24] = (250, 10, 10)
    return TrainingImages(list(pixels))


def test_the_loss_is_zero_between_the_masks_and_pulls_p_there_from_outside():
    p = torch.linspace(0, 1, 11, dtype=torch.float64, requires_grad=True)
    for lower, upper in ((0.0, 1.0), (1.0, 1.0), (0.0, 0.0), (0.25, 0.75)):
        loss = hinge(p, torch.tensor(lower), torch.tensor(upper))
        expected = [max(v - upper, 0) + max(lower - v, 0) for v in p.tolist()]
        assert np.allclose(loss.detach(), expected, atol=1e-15)
    (gradient,) = torch.autograd.grad(hinge(p, torch.tensor(0.25), torch.tensor(0.75)).sum(), p)
    assert gradient.tolist() == [-1] * 3 + [0] * 5 + [1] * 3


def test_places_are_encoded_by_octaves_of_both_axes_and_averaged():
    encoded = encoded_places(3, 5, 4).double().numpy()
    assert encoded.shape == (15, 16)
    y, x = 1 / 2, 3 / 4
    row = encoded[1 * 5 + 3]
    octaves = 2.0 ** np.arange(4)
    expected = np.concatenate([np.sin(y * octaves), np.sin(x * octaves), np.cos(y * octaves), np.cos(x * octaves)])
    assert np.allclose(row, expected, atol=1e-6)
    assert torch.isfinite(encoded_places(1, 1, 20)).all()
    plane = np.repeat([True, False], (2, 6))[:, None].repeat(8, axis=1)
    assert np.allclose(averaged(plane, (2, 2)), [[0.5, 0.5], [0, 0]])  # shares under positions


def test_what_looks_like_outliers_is_left_out_where_residuals_say_nothing():
    """Learned from views 0 and 1 alone; view 2 has a square as view 0 has."""
    images = photographs()
    network = MaskNetwork(images, blocks, CONFIG, 0)
    square = np.zeros((32, 48), bool)
    square[:16, :24] = True
    nothing, everything = np.zeros_like(square), np.ones_like(square)
    for iteration in range(150):
        inlier = ~square if iteration % 2 == 0 else everything
        network.learn(iteration % 2, inlier, inlier)
    p = network.learn(2, nothing, everything)  # L and U that any p is between
    assert p[4:12, 4:20].max() < 0.3
    assert p[24:, 30:].min() > 0.7


def test_p_has_the_size_of_the_masks_and_a_state_restores_it():
    network = MaskNetwork(photographs(), blocks, CONFIG, 0, extra=1)
    inlier, plane = np.ones((16, 24), bool), np.full((4, 6), 0.5, np.float32)
    first = network.learn(1, ~inlier, ~inlier, extra=[plane])
    assert first.shape == (16, 24)
    again = MaskNetwork(photographs(), blocks, CONFIG, 5, extra=1)
    again.load_state_dict(network.state_dict())
    one, other = (net.learn(1, inlier, inlier, extra=[plane]) for net in (network, again))
    assert np.array_equal(one, other)
    assert not np.array_equal(one, first)
    prior = MaskNetwork(photographs(), blocks, MaskNetworkConfig("vgg", prior=0.9), 0)
    assert prior.learn(0, inlier, inlier).mean() == pytest.approx(0.9, abs=0.06)
