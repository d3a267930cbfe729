"""The network, and its branch that takes mist off, against their definitions."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_network import TINY
from torch.nn import functional

from deraings.enhancement.architecture.mist_branch import (
    FLOOR,
    MAX_ALPHA,
    TRUE_MIST,
    MistBranch,
    crop_mist,
    decoded,
    encoded,
    mist_loss,
    squeezed,
    statistics,
    without_mist,
)
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
from deraings.enhancement.enhance import enhance, padded
from deraings.enhancement.weights import Enhancer
from hydroviews.scene.images import to_linear, to_srgb


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


WHOLE = torch.tensor([[0.0, 1.0, 0.0, 1.0]])


def squares(count: int, seed: int, side: int = 128) -> torch.Tensor:
    """Squares of colours, among them black and saturated ones."""
    rng = torch.Generator().manual_seed(seed)
    coarse = torch.rand(count, 3, 16, 16, generator=rng) * (torch.rand(count, 3, 16, 16, generator=rng) > 0.4)
    return functional.interpolate(coarse, size=(side, side))


def mists(count: int, seed: int, side: int = 128) -> torch.Tensor:
    """Thick on one side, thin on the other, of white light."""
    rng = torch.Generator().manual_seed(seed)
    corners = 0.8 * torch.rand(count, 1, 2, 2, generator=rng)
    thickness = functional.interpolate(corners, size=(side, side), mode="bilinear", align_corners=True)
    return torch.cat([thickness, torch.full((count, 3, side, side), 0.8)], dim=1)


def misty(clean: torch.Tensor, mist: torch.Tensor) -> torch.Tensor:
    return encoded((1 - mist[:, :1]) * decoded(clean) + mist[:, :1] * mist[:, 1:])


def test_light_is_that_of_the_rest_of_the_project():
    values = np.linspace(0, 1, 1001, dtype=np.float32)
    np.testing.assert_allclose(decoded(torch.from_numpy(values)), to_linear(values), atol=1e-6)
    np.testing.assert_allclose(encoded(torch.from_numpy(values)), to_srgb(values), atol=1e-6)
    assert encoded(torch.tensor(-0.1)) == 0


def test_known_mist_is_taken_off():
    clean, mist = squares(2, 0), mists(2, 1)
    rainy = misty(clean, mist)
    assert (rainy - clean).abs().mean() > 0.1
    assert torch.allclose(without_mist(rainy, mist), clean, atol=1e-3)
    assert torch.allclose(without_mist(clean, 0 * mist), clean, atol=1e-5)


def test_a_part_has_its_part_of_the_mist():
    mist = torch.rand(1, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    whole = crop_mist(mist, WHOLE, 120, 80)
    expected = functional.interpolate(mist, size=(120, 80), mode="bilinear", align_corners=False)
    assert torch.allclose(whole, expected, atol=1e-5)
    part = crop_mist(mist, torch.tensor([[30 / 120, 90 / 120, 10 / 80, 50 / 80]]), 60, 40)
    assert torch.allclose(part, whole[..., 30:90, 10:50], atol=1e-5)


def test_statistics_are_those_of_cells_and_a_speck_does_not_hide_mist():
    picture = squares(1, 3)
    found = statistics(picture)[0]
    cell = picture[0, :, 16:24, 32:40]
    assert found.shape == (20, 16, 16)
    assert torch.allclose(found[:3, 2, 4], cell.mean((1, 2)), atol=1e-6)
    assert torch.equal(found[6:9, 2, 4], cell.amax((1, 2)))
    assert torch.equal(found[9:12, 2, 4], cell.amin((1, 2)))
    speck = torch.full((1, 3, 128, 128), 0.5)
    speck[..., 3, 5] = 0
    change = (statistics(speck) - statistics(torch.full_like(speck, 0.5)))[0, :, 0, 0]
    assert change[9:12].abs().max() == pytest.approx(0.5)
    assert change[12:15].abs().max() == pytest.approx(0.5 / 16)


def with_light(mist: torch.Tensor) -> torch.Tensor:
    """V and V w of V and w."""
    return torch.cat([mist[:, :1], mist[:, :1] * mist[:, 1:]], dim=1)


def test_the_loss_is_in_the_logarithm_of_what_is_left():
    clean = torch.full((1, 3, 128, 128), 0.5)
    none, unknown = torch.zeros(1, 4, 16, 16), torch.full((1, 4, 128, 128), torch.nan)
    assert mist_loss(none, clean, clean, unknown) == pytest.approx(np.log(FLOOR), abs=1e-4)
    assert mist_loss(none, clean + 0.2, clean, unknown) == pytest.approx(np.log(0.2), abs=0.01)
    mist, picture = mists(1, 2, 16), squares(1, 2)
    fine = functional.interpolate(mist, size=(128, 128), mode="bilinear", align_corners=False)
    rainy = misty(picture, fine)
    assert mist_loss(mist, rainy, picture, with_light(fine)) == pytest.approx(np.log(FLOOR), abs=0.15)


def test_the_loss_is_in_the_true_mist_where_it_is_known():
    clean, none = torch.full((2, 3, 128, 128), 0.5), torch.zeros(2, 4, 16, 16)
    truth = torch.full((2, 4, 128, 128), 0.1)
    known = mist_loss(none, clean, clean, truth) - np.log(FLOOR)
    assert known == pytest.approx(0.1 * TRUE_MIST, abs=1e-3)
    truth[1] = torch.nan
    none.requires_grad_(True)
    half = mist_loss(none, clean, clean, truth)
    assert float(half.detach()) - np.log(FLOOR) == pytest.approx(0.1 * TRUE_MIST, abs=1e-3)
    half.backward()
    assert torch.isfinite(none.grad).all()


def test_an_untrained_network_finds_no_mist_and_a_trained_one_what_there_is():
    torch.manual_seed(0)
    network = EnhancementNetwork(TINY).mist
    clean, thick = squares(8, 100), mists(8, 200)
    rainy = misty(clean, thick)
    assert not network(rainy)[:, 0].any()
    truth = with_light(thick)
    before = mist_loss(network(rainy), rainy, clean, truth)
    optimiser = torch.optim.AdamW(network.parameters(), 5e-3)
    for step in range(100):
        dry, mist = squares(8, step), mists(8, step + 50)
        wet = misty(dry, mist)
        optimiser.zero_grad()
        mist_loss(network(wet), wet, dry, with_light(mist)).backward()
        optimiser.step()
    with torch.no_grad():
        found = network(rainy)
        assert mist_loss(found, rainy, clean, truth) < before - np.log(10 ** (6 / 20))  # 6 dB better
        assert (found[:, :1] - functional.adaptive_avg_pool2d(truth[:, :1], 16)).abs().mean() < 0.15
        larger = functional.interpolate(rainy, scale_factor=4)
        assert torch.allclose(network(larger), found, atol=1e-3)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_pictures_give_the_branch_finite_gradients(value):
    network, flat = MistBranch(8), torch.full((1, 3, 40, 60), value)
    mist = network(flat)
    assert mist[:, 0].abs().max() <= MAX_ALPHA
    loss = mist_loss(mist, squeezed(flat), squeezed(flat), torch.zeros(1, 4, 128, 128))
    (without_mist(flat, crop_mist(mist, WHOLE, 40, 60)).sum() + loss).backward()
    assert all(torch.isfinite(p.grad).all() for p in network.parameters())


def test_tiles_share_the_mist_of_the_whole_picture():
    enhancer = Enhancer(EnhancementNetwork(TINY).requires_grad_(False), {}, "for a test")
    torch.nn.init.normal_(enhancer.network.mist.end.weight, std=0.1)
    image = np.random.default_rng(0).random((90, 150, 3)).astype(np.float32)
    whole = enhance(image, enhancer)
    assert np.abs(whole - image).max() > 0.01
    np.testing.assert_allclose(enhance(image, enhancer, tile=64, overlap=16), whole, atol=1e-5)
    kept = enhance(image, enhancer, remove_mist=False)
    np.testing.assert_allclose(kept, image, atol=1e-6)  # the rest of the network is untrained and changes nothing
