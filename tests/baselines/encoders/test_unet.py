"""The U-Net: shapes for any picture, masks that begin open, weights of ResNet-18 by name."""

import pytest
import torch
from safetensors.torch import save_file

from baselines.encoders.resnet_weights import load_resnet
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
