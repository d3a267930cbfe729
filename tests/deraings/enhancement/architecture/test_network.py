from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_network import TINY

from deraings.enhancement.architecture.network import (
    CONFIGS,
    KEPT,
    PAPER,
    ChannelNorm,
    EnhancementNetwork,
    SparseAttention,
    TransposedAttention,
)
from deraings.enhancement.architecture.size import describe, measure
from deraings.enhancement.enhance import padded


def pictures(height: int = 32, width: int = 64, count: int = 1, seed: int = 0) -> torch.Tensor:
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(seed))


def awake(config=TINY, seed: int = 0) -> EnhancementNetwork:
    """A network whose last layer is not zero."""
    torch.manual_seed(seed)
    network = EnhancementNetwork(config)
    torch.nn.init.normal_(network.head[0].weight, std=0.001)
    return network.requires_grad_(False)


@pytest.mark.parametrize("gain", [False, True])
def test_untrained_network_changes_nothing(gain):
    image = pictures()
    assert torch.equal(EnhancementNetwork(replace(TINY, gain=gain, mist=0))(image), image)
    assert torch.allclose(EnhancementNetwork(replace(TINY, gain=gain))(image), image, atol=1e-5)


def test_the_papers_network_has_its_depths_and_about_38_million_parameters():
    parts = measure(PAPER, 64, 64)
    assert 37e6 < sum(part.parameters for part in parts.values()) < 39e6
    with torch.device("meta"):
        network = EnhancementNetwork(PAPER)
    assert [len(blocks) for blocks in network.encoder] == [4, 6, 7, 8]
    assert [len(blocks) for blocks in network.decoder] == [3, 6, 7, 8]
    assert len(network.bottleneck) == 8
    assert not PAPER.gain
    assert not PAPER.mist
    assert PAPER.stem == 1


def test_multiply_adds_grow_with_the_picture_and_are_those_of_the_stem():
    small, large = measure(TINY, 64, 32), measure(TINY, 128, 32)
    taken = 3 * TINY.stem**2
    assert small["stem"].operations == (64 * 32 // TINY.stem**2) * taken * TINY.width * 9
    parts = [name for name in small if "mist" not in name]  # which always looks at as many cells
    assert all(large[name].operations >= 1.9 * small[name].operations for name in parts)
    assert "multiply-adds" in describe(CONFIGS["small"], 400, 300)


def test_any_size_runs_and_the_picture_is_not_shifted():
    network, fitting = awake(), pictures(32, 64)
    assert network.multiple == 32
    for height, width in ((1, 1), (5, 70), (33, 31)):
        assert padded(network.refine, 32, pictures(height, width)).shape == (1, 3, height, width)
    assert torch.equal(padded(network.refine, 32, fitting), network.refine(fitting))


def test_channel_norm_is_layer_norm_of_each_pixel():
    x = torch.randn(2, 6, 3, 5, dtype=torch.float64)
    expected = (x - x.mean(1, keepdim=True)) / torch.sqrt(x.var(1, unbiased=False, keepdim=True) + 1e-5)
    assert torch.allclose(ChannelNorm(6).double()(x), expected)


def reference_attention(block: TransposedAttention, x: np.ndarray) -> np.ndarray:
    """Attention between the channels of one picture [C, H, W], every step written out."""
    with torch.no_grad():
        mixed = block.gather(block.project(block.norm(torch.from_numpy(x)[None])))[0].numpy()
    channels = len(x)
    query, key, value = mixed.reshape(3, block.heads, channels // block.heads, -1)
    attended = []
    for head in range(block.heads):
        q, k = (part[head] / np.linalg.norm(part[head], axis=1, keepdims=True) for part in (query, key))
        scores = q @ k.T * block.scale[head].item()
        if isinstance(block, SparseAttention):
            weights = np.zeros_like(scores)
            for share, weight in zip(KEPT, block.kept.tolist(), strict=True):
                for row in range(len(scores)):
                    best = np.argsort(scores[row])[::-1][: max(1, int(len(scores) * share))]
                    exponents = np.exp(scores[row, best])
                    weights[row, best] += weight * exponents / exponents.sum()
        else:
            weights = np.exp(scores) / np.exp(scores).sum(axis=1, keepdims=True)
        attended.append(weights @ value[head])
    stacked = torch.from_numpy(np.concatenate(attended).reshape(x.shape))[None]
    with torch.no_grad():
        return x + block.output(stacked)[0].numpy()


@pytest.mark.parametrize("kind", [TransposedAttention, SparseAttention])
def test_attention_agrees_with_its_definition(kind):
    torch.manual_seed(0)
    block = kind(12, 2).double()
    block.scale.data = torch.tensor([3.0, 0.5]).double().reshape(2, 1, 1)
    x = torch.randn(1, 12, 4, 6, dtype=torch.float64)
    with torch.no_grad():
        found = block(x)[0].numpy()
    np.testing.assert_allclose(found, reference_attention(block, x[0].numpy()), atol=1e-10)


def test_flat_pictures_give_finite_gradients():
    network = awake().requires_grad_(True)
    network(torch.zeros(1, 3, 32, 32)).square().sum().backward()
    assert all(p.grad is None or torch.isfinite(p.grad).all() for p in network.parameters())
