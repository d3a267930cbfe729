import numpy as np
import pytest
import torch
from tiny_network import TINY
from torch.nn import functional

from deraings.enhancement.enhance import enhance
from deraings.enhancement.network import EnhancementNetwork
from deraings.enhancement.veil import (
    FLOOR,
    THICKEST,
    TRUTH,
    VeilNetwork,
    cut,
    decoded,
    encoded,
    lifted,
    squeezed,
    statistics,
    veil_loss,
)
from deraings.enhancement.weights import Enhancer
from hydroviews.scene.images import to_linear, to_srgb

WHOLE = torch.tensor([[0.0, 1.0, 0.0, 1.0]])


def pictures(count: int, seed: int, side: int = 128) -> torch.Tensor:
    """Squares of colours, among them black and saturated ones."""
    rng = torch.Generator().manual_seed(seed)
    coarse = torch.rand(count, 3, 16, 16, generator=rng) * (torch.rand(count, 3, 16, 16, generator=rng) > 0.4)
    return functional.interpolate(coarse, size=(side, side))


def veils(count: int, seed: int, side: int = 128) -> torch.Tensor:
    """Thick on one side, thin on the other, of white light."""
    rng = torch.Generator().manual_seed(seed)
    corners = 0.8 * torch.rand(count, 1, 2, 2, generator=rng)
    thickness = functional.interpolate(corners, size=(side, side), mode="bilinear", align_corners=True)
    return torch.cat([thickness, torch.full((count, 3, side, side), 0.8)], dim=1)


def veiled(clean: torch.Tensor, veil: torch.Tensor) -> torch.Tensor:
    return encoded((1 - veil[:, :1]) * decoded(clean) + veil[:, :1] * veil[:, 1:])


def test_light_is_that_of_the_rest_of_the_project():
    values = np.linspace(0, 1, 1001, dtype=np.float32)
    np.testing.assert_allclose(decoded(torch.from_numpy(values)), to_linear(values), atol=1e-6)
    np.testing.assert_allclose(encoded(torch.from_numpy(values)), to_srgb(values), atol=1e-6)
    assert encoded(torch.tensor(-0.1)) == 0


def test_a_known_veil_is_lifted():
    clean, veil = pictures(2, 0), veils(2, 1)
    rainy = veiled(clean, veil)
    assert (rainy - clean).abs().mean() > 0.1
    assert torch.allclose(lifted(rainy, veil), clean, atol=1e-3)
    assert torch.allclose(lifted(clean, 0 * veil), clean, atol=1e-5)


def test_a_part_has_its_part_of_the_veil():
    veil = torch.rand(1, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    whole = cut(veil, WHOLE, 120, 80)
    expected = functional.interpolate(veil, size=(120, 80), mode="bilinear", align_corners=False)
    assert torch.allclose(whole, expected, atol=1e-5)
    part = cut(veil, torch.tensor([[30 / 120, 90 / 120, 10 / 80, 50 / 80]]), 60, 40)
    assert torch.allclose(part, whole[..., 30:90, 10:50], atol=1e-5)


def test_statistics_are_those_of_cells():
    picture = pictures(1, 3)
    found = statistics(picture)[0]
    cell = picture[0, :, 16:24, 32:40]
    assert found.shape == (20, 16, 16)
    assert torch.allclose(found[:3, 2, 4], cell.mean((1, 2)), atol=1e-6)
    assert torch.equal(found[6:9, 2, 4], cell.amax((1, 2)))
    assert torch.equal(found[9:12, 2, 4], cell.amin((1, 2)))


def test_a_speck_does_not_hide_a_veil():
    grey, speck = torch.full((1, 3, 128, 128), 0.5), torch.full((1, 3, 128, 128), 0.5)
    speck[..., 3, 5] = 0
    change = (statistics(speck) - statistics(grey))[0, :, 0, 0]
    assert change[9:12].abs().max() == pytest.approx(0.5)
    assert change[12:15].abs().max() == pytest.approx(0.5 / 16)


def with_light(veil: torch.Tensor) -> torch.Tensor:
    """V and V w of V and w."""
    return torch.cat([veil[:, :1], veil[:, :1] * veil[:, 1:]], dim=1)


def test_the_loss_is_in_the_logarithm_of_what_is_left():
    clean = torch.full((1, 3, 128, 128), 0.5)
    none, unknown = torch.zeros(1, 4, 16, 16), torch.full((1, 4, 128, 128), torch.nan)
    assert veil_loss(none, clean, clean, unknown) == pytest.approx(np.log(FLOOR), abs=1e-4)
    assert veil_loss(none, clean + 0.2, clean, unknown) == pytest.approx(np.log(0.2), abs=0.01)
    veil, picture = veils(1, 2, 16), pictures(1, 2)
    fine = functional.interpolate(veil, size=(128, 128), mode="bilinear", align_corners=False)
    rainy = veiled(picture, fine)
    assert veil_loss(veil, rainy, picture, with_light(fine)) == pytest.approx(np.log(FLOOR), abs=0.15)


def test_the_loss_is_in_the_true_veil_where_it_is_known():
    clean, none = torch.full((2, 3, 128, 128), 0.5), torch.zeros(2, 4, 16, 16)
    truth = torch.full((2, 4, 128, 128), 0.1)
    known = veil_loss(none, clean, clean, truth) - np.log(FLOOR)
    assert known == pytest.approx(0.1 * TRUTH, abs=1e-3)
    truth[1] = torch.nan
    none.requires_grad_(True)
    half = veil_loss(none, clean, clean, truth)
    assert float(half.detach()) - np.log(FLOOR) == pytest.approx(0.1 * TRUTH, abs=1e-3)
    half.backward()
    assert torch.isfinite(none.grad).all()


def test_an_untrained_network_finds_no_veil_and_a_trained_one_what_there_is():
    torch.manual_seed(0)
    network = EnhancementNetwork(TINY).veil
    clean, thick = pictures(8, 100), veils(8, 200)
    rainy = veiled(clean, thick)
    assert not network(rainy)[:, 0].any()
    truth = with_light(thick)
    before = veil_loss(network(rainy), rainy, clean, truth)
    optimiser = torch.optim.AdamW(network.parameters(), 5e-3)
    for step in range(100):
        dry, veil = pictures(8, step), veils(8, step + 50)
        wet = veiled(dry, veil)
        optimiser.zero_grad()
        veil_loss(network(wet), wet, dry, with_light(veil)).backward()
        optimiser.step()
    with torch.no_grad():
        found = network(rainy)
        assert veil_loss(found, rainy, clean, truth) < before - np.log(10 ** (6 / 20))  # 6 dB better
        assert (found[:, :1] - functional.adaptive_avg_pool2d(truth[:, :1], 16)).abs().mean() < 0.15
        larger = functional.interpolate(rainy, scale_factor=4)
        assert torch.allclose(network(larger), found, atol=1e-3)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_pictures_give_finite_gradients(value):
    network = VeilNetwork(8)
    flat = torch.full((1, 3, 40, 60), value)
    veil = network(flat)
    assert veil[:, 0].abs().max() <= THICKEST
    (
        lifted(flat, cut(veil, WHOLE, 40, 60)).sum()
        + veil_loss(veil, squeezed(flat), squeezed(flat), torch.zeros(1, 4, 128, 128))
    ).backward()
    assert all(torch.isfinite(p.grad).all() for p in network.parameters())


def test_tiles_share_the_veil_of_the_whole_picture():
    torch.manual_seed(0)
    network = EnhancementNetwork(TINY).requires_grad_(False)
    torch.nn.init.normal_(network.veil.end.weight, std=0.1)
    image = np.random.default_rng(0).random((90, 150, 3)).astype(np.float32)
    whole = enhance(image, Enhancer(network, {}, "for a test"))
    assert np.abs(whole - image).max() > 0.01
    np.testing.assert_allclose(
        enhance(image, Enhancer(network, {}, "for a test"), tile=64, overlap=16), whole, atol=1e-5
    )
    kept = enhance(image, Enhancer(network, {}, "for a test"), lift=False)
    np.testing.assert_allclose(kept, image, atol=1e-6)  # the rest of the network is untrained and changes nothing
