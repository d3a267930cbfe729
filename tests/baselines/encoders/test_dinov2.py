"""Our DINOv2: the transformer that torch has, weights by hash alone, and errors that say what to do."""

import hashlib
import pickle

import numpy as np
import pytest
import torch
from servers import serving

from baselines.encoders import dinov2
from baselines.encoders.dinov2 import VisionTransformer, load_dinov2, weights_file, with_weights
from baselines.encoders.frozen import DinoV2, calibrated
from baselines.wild_gaussians.method import WildGaussians
from hydroviews.errors import InputError

TINY = {"width": 24, "heads": 2, "depth": 2, "registers": 3, "grid": 3}
CPU = torch.device("cpu")
NAME = "dinov2_vits14_reg4_pretrain.pth"


def tiny(depth=2):
    """A small network whose weights are all random."""
    torch.manual_seed(0)
    network = VisionTransformer(**{**TINY, "depth": depth})
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, 0, 0.3)
    return network.requires_grad_(False).eval()


def reference_block(block):
    """The same block made of torch's own transformer layer."""
    width, attention, mlp = TINY["width"], block.attn, block.mlp
    layer = torch.nn.TransformerEncoderLayer(
        width, TINY["heads"], 4 * width, 0.0, "gelu", 1e-6, batch_first=True, norm_first=True
    )
    state = {
        "self_attn.in_proj_weight": attention.qkv.weight,
        "self_attn.in_proj_bias": attention.qkv.bias,
        "self_attn.out_proj.weight": block.ls1["gamma"][:, None] * attention.proj.weight,  # the scale, multiplied in
        "self_attn.out_proj.bias": block.ls1["gamma"] * attention.proj.bias,
        "linear1.weight": mlp["fc1"].weight,
        "linear1.bias": mlp["fc1"].bias,
        "linear2.weight": block.ls2["gamma"][:, None] * mlp["fc2"].weight,
        "linear2.bias": block.ls2["gamma"] * mlp["fc2"].bias,
        **{f"norm{k}.{part}": getattr(getattr(block, f"norm{k}"), part) for k in (1, 2) for part in ("weight", "bias")},
    }
    layer.load_state_dict(state)
    return layer.requires_grad_(False).eval()


def test_blocks_are_those_of_torch():
    network, image = tiny(), torch.randn(3, 42, 42, generator=torch.manual_seed(1))
    pixels = image.unfold(1, 14, 14).unfold(2, 14, 14).permute(1, 2, 0, 3, 4).reshape(9, -1)  # patches, row by row
    embedded = pixels @ network.patch_embed["proj"].weight.flatten(1).T + network.patch_embed["proj"].bias
    x = torch.cat([network.cls_token[0], embedded]) + network.pos_embed[0]
    x = torch.cat([x[:1], network.register_tokens[0], x[1:]])[None]
    for block in network.blocks:
        x = reference_block(block)(x)
    expected = network.norm(x)[0, 1 + TINY["registers"] :].T.reshape(-1, 3, 3)
    assert torch.allclose(network(image), expected, atol=1e-4)


def test_pictures_may_have_any_number_of_patches():
    network = tiny()
    assert network(torch.zeros(3, 28, 70)).shape == (24, 2, 5)
    network.pos_embed[:, 1:] = torch.linspace(0, 1, 3).repeat_interleave(3)[None, :, None]  # rises downwards
    first, rest = network.positions(6, 2).split([1, 12])
    positions = rest.unflatten(0, (6, 2))
    assert torch.allclose(positions[:, 0], positions[:, 1], atol=1e-6)
    assert (positions[1:, 0] > positions[:-1, 0]).all()
    assert torch.equal(first[0], network.pos_embed[0, 0])
    assert torch.equal(network.positions(3, 3), network.pos_embed[0])


def test_the_full_network_has_the_published_shapes():
    with torch.device("meta"):
        shapes = {name: tuple(value.shape) for name, value in VisionTransformer().state_dict().items()}
    assert shapes["pos_embed"] == (1, 1370, 384)
    assert shapes["register_tokens"] == (1, 4, 384)
    assert shapes["patch_embed.proj.weight"] == (384, 3, 14, 14)
    assert shapes["blocks.5.attn.qkv.weight"] == (1152, 384)
    assert shapes["blocks.5.mlp.fc1.weight"] == (1536, 384)
    layers = "norm1", "norm2", "attn.qkv", "attn.proj", "mlp.fc1", "mlp.fc2"
    first = {f"{layer}.{part}" for layer in layers for part in ("weight", "bias")} | {"ls1.gamma", "ls2.gamma"}
    assert {name.removeprefix("blocks.0.") for name in shapes if name.startswith("blocks.0.")} == first


@pytest.fixture
def published(tmp_path, monkeypatch):
    """A server with weights of a small network of three blocks, of which two are wanted; returns it and the network."""
    deep, path = tiny(3), tmp_path / "published.pth"
    torch.save({**deep.state_dict(), "mask_token": torch.zeros(1, 24)}, path)
    content = path.read_bytes()
    monkeypatch.delenv("HYDROVIEWS_DINOV2", raising=False)
    monkeypatch.setenv("HYDROVIEWS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(dinov2, "SHA256", hashlib.sha256(content).hexdigest())
    monkeypatch.setattr(dinov2, "VisionTransformer", lambda: VisionTransformer(**TINY))
    with serving({f"/{NAME}": content}) as server:
        monkeypatch.setattr(dinov2, "URL", f"{server.address}/{NAME}")
        yield server, deep


def test_weights_are_fetched_once_and_read_by_name(published):
    server, deep = published
    image = torch.randn(3, 28, 42, generator=torch.manual_seed(2))
    deep.blocks = deep.blocks[:2]
    for _ in range(2):
        assert torch.equal(load_dinov2(CPU)(image), deep(image))
    assert len(server.asked) == 1


def test_features_are_of_whole_patches(published):
    network, seen = calibrated("dinov2", "cpu"), []
    assert isinstance(network, DinoV2)
    assert network(np.zeros((36, 48, 3), np.float32)).shape == (24, 3, 4)
    network._network = lambda x: seen.append(x) or x
    network(np.full((28, 28, 3), 0.485, np.float32))
    assert seen[0].shape == (3, 28, 28)
    assert seen[0][0].abs().max() < 1e-6  # the mean red of ImageNet


class Trap:
    """Runs code when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return exec, (f"open({str(self.mark)!r}, 'w')",)


def test_another_file_is_refused_before_it_is_opened(published, tmp_path, monkeypatch):
    trap = tmp_path / "trap.pth"
    trap.write_bytes(pickle.dumps(Trap(tmp_path / "ran")))
    published[0].files[f"/{NAME}"] = trap.read_bytes()
    with pytest.raises(InputError, match="wrong checksum"):
        load_dinov2(CPU)
    assert not (tmp_path / "cache" / NAME).exists()
    monkeypatch.setenv("HYDROVIEWS_DINOV2", str(trap))
    with pytest.raises(InputError, match=r"not DINOv2's weights(.|\n)*expected: [0-9a-f]{64}"):
        load_dinov2(CPU)
    with pytest.raises(pickle.UnpicklingError):
        with_weights(VisionTransformer(**TINY), trap)  # nor would it have run
    assert not (tmp_path / "ran").exists()


def test_a_copy_may_be_named(published, tmp_path, monkeypatch):
    copy = tmp_path / "copy.pth"
    copy.write_bytes(published[0].files[f"/{NAME}"])
    monkeypatch.setenv("HYDROVIEWS_DINOV2", str(copy))
    assert weights_file() == copy
    load_dinov2(CPU)
    assert not published[0].asked
    monkeypatch.setenv("HYDROVIEWS_DINOV2", str(tmp_path / "none.pth"))
    with pytest.raises(InputError, match="correct HYDROVIEWS_DINOV2"):
        load_dinov2(CPU)


def test_a_lack_of_memory_says_what_to_do(published, monkeypatch):
    def exhausted(*_):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20 MiB")

    network = calibrated("dinov2", "cpu")
    network._network = exhausted
    with pytest.raises(InputError, match=r"does not fit the memory of cpu(.|\n)*HYDROVIEWS_FEATURES=alexnet"):
        network(np.zeros((28, 28, 3), np.float32))
    monkeypatch.setattr(VisionTransformer, "to", exhausted)
    with pytest.raises(InputError, match="does not fit the memory"):
        calibrated("dinov2", "cpu")


def test_the_network_is_a_setting_of_the_profile(monkeypatch):
    def features(profile):
        return WildGaussians.configuration(profile).uncertainty.features

    monkeypatch.delenv("HYDROVIEWS_FEATURES", raising=False)
    assert [features(profile) for profile in ("demo", "standard", "paper")] == ["alexnet", "alexnet", "dinov2"]
    monkeypatch.setenv("HYDROVIEWS_FEATURES", "alexnet")
    assert features("paper") == "alexnet"
    monkeypatch.setenv("HYDROVIEWS_FEATURES", "auto")
    with pytest.raises(InputError, match="dinov2 or alexnet"):
        features("standard")
