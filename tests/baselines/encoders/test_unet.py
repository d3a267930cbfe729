"""Encoders of pictures: frozen features, the U-Net, weights by name, and how maps are read at points."""

import numpy as np
import pytest
import torch
from by_hand import assert_same_values_and_gradients
from safetensors.torch import save_file
from splats import camera
from torch.nn import functional

from baselines.encoders.frozen import AlexNet, frozen, shrunk, standardise, unlikeness
from baselines.encoders.resnet_weights import load_resnet
from baselines.encoders.sampling import boxed, projected, sample
from baselines.encoders.unet import VISIBLE_AT_FIRST, ResNet18
from baselines.gs_w.encoder import ReferenceEncoder
from hydroviews.errors import InputError


@pytest.mark.parametrize(("backbone", "finest"), [("small", 4), ("resnet18", 2)])
def test_maps_and_mask_have_their_resolution_all_is_seen_at_first_and_every_weight_learns(backbone, finest):
    net = ReferenceEncoder(backbone, 12)
    picture = torch.rand(1, 3, net.multiple * 2, net.multiple * 3, generator=torch.Generator().manual_seed(0)) - 0.5
    assert torch.allclose(net(picture)[1], torch.tensor(VISIBLE_AT_FIRST))
    descent = torch.optim.SGD(net.parameters(), 1e-3)
    for _ in range(3):  # blocks and masks begin with zeros that let nothing through at first
        maps, visible = net(picture)
        descent.zero_grad()
        (maps.square().mean() + (visible * picture[0, 0, ::4, ::4]).mean()).backward()
        descent.step()
    assert maps.shape == (12, net.multiple * 2 // finest, net.multiple * 3 // finest)
    assert visible.shape == (net.multiple // 2, net.multiple * 3 // 4)
    assert [name for name, p in net.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0] == []


@pytest.mark.parametrize("suffix", ["safetensors", "pth"])
def test_weights_are_taken_over_by_name(tmp_path, suffix):
    weights = {name: torch.rand_like(value) for name, value in ResNet18().state_dict().items()}
    more = {**weights, "fc.weight": torch.zeros(2, 512), "bn1.num_batches_tracked": torch.tensor(1)}
    path, net = tmp_path / f"resnet18.{suffix}", ReferenceEncoder("resnet18", 12)
    save_file(more, path) if suffix == "safetensors" else torch.save(more, path)
    load_resnet(net.backbone, path)
    assert all(torch.equal(value, weights[name]) for name, value in net.backbone.state_dict().items())


def test_what_is_no_resnet_is_refused(tmp_path):
    backbone, path = ReferenceEncoder("resnet18", 12).backbone, tmp_path / "weights.safetensors"
    with pytest.raises(InputError, match="no such file"):
        load_resnet(backbone, path)
    save_file({"conv1.weight": torch.zeros(3)}, path)
    (tmp_path / "weights.pth").write_bytes(b"no zip at all")
    for wrong in (path, tmp_path / "weights.pth"):
        with pytest.raises(InputError, match="not weights of ResNet-18"):
            load_resnet(backbone, wrong)


def test_alexnet_tells_a_blurred_picture_from_another():
    generator = np.random.default_rng(0)
    one, other = (generator.random((12, 16, 3)).repeat(8, 0).repeat(8, 1).astype(np.float32) for _ in range(2))
    network = AlexNet("cpu")
    dim = unlikeness(network(one), network(0.7 * one + 0.1))
    assert unlikeness(network(one), network(one)).max() == 0
    assert dim.mean() < 0.2
    assert unlikeness(network(one), network(other)).mean() > 0.25
    assert network(one).shape == (384, 5, 7)
    with pytest.raises(InputError, match="too small"):
        network(one[:20])
    assert shrunk(np.zeros((700, 525, 3), np.float32)).shape == (350, 262, 3)


def test_features_are_standardised_over_all_pictures_and_constant_ones_vanish():
    made = [3 + 2 * torch.randn(5, 8, 6, generator=torch.Generator().manual_seed(k)) for k in range(3)]
    for seen in made:
        seen[4] = 7
    standardise(made)
    found = torch.cat([seen.double().flatten(1) for seen in made], dim=1)
    assert found[:4].mean(dim=1).abs().max() < 1e-3
    assert (found[:4].std(dim=1, correction=0) - 1).abs().max() < 1e-3
    assert not found[4].any()


def test_vgg_has_a_position_for_four_by_four_pixels():
    network = frozen("vgg", "cpu")
    image = np.random.default_rng(0).random((36, 48, 3)).astype(np.float32)
    assert network(image).shape == (256, 9, 12)
    with pytest.raises(InputError, match="too small"):
        network(image[:12])


def points(n, maps):
    return 1.3 * (2 * torch.rand(n, maps, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64) - 1)


@pytest.mark.parametrize("size", [(5, 8), (1, 6), (6, 1), (1, 1)])
def test_values_and_gradients_are_those_of_torchs_sampler(size):
    maps = torch.rand(3, 4, *size, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    upstream = torch.rand(40, 12, generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def theirs(maps, at):
        grid = at.transpose(0, 1)[:, :, None]
        found = functional.grid_sample(maps, grid, padding_mode="border", align_corners=False)
        return found[..., 0].permute(2, 0, 1).flatten(1)

    assert_same_values_and_gradients(sample, theirs, upstream, maps, points(40, 3))


def test_points_are_seen_where_the_camera_projects_them():
    view, means = camera(23, 17), np.random.default_rng(0).uniform(-1, 1, (20, 3)).astype(np.float32)
    expected = 2 * view.project(means)[0] / (view.width, view.height) - 1
    assert np.allclose(projected(torch.from_numpy(means), view).numpy(), expected, atol=1e-5)


def test_the_box_adds_the_gradient_of_its_loss_and_nothing_else():
    x, twin = (points(30, 2).requires_grad_() for _ in range(2))
    assert (x.detach().abs() > 1).any()
    out = boxed(x, 0.7)
    assert torch.equal(out, x)
    (out**2).sum().backward()
    ((twin**2).sum() + 0.7 * functional.relu(twin.abs() - 1).mean()).backward()
    assert torch.allclose(x.grad, twin.grad, atol=1e-12)
