"""Files of trained networks."""

import json

import pytest
import torch
from tiny_supervised import LayerConfig, Toy

from baselines.derain_nerf.raindrop_attention import weights as attention
from baselines.derain_nerf.raindrop_attention.config import SMALL_GENERATOR
from baselines.supervised.weights import NetworkFiles, rounded
from deraings.enhancement import weights as enhancement
from deraings.enhancement.architecture.network import SMALL
from hydroviews.errors import InputError

CARD = {"data": "noise", "steps": 6}


@pytest.fixture
def files(tmp_path):
    return NetworkFiles("toy", tmp_path, "network", lambda config: Toy(LayerConfig(**config)))


def test_weights_come_back_with_their_configuration_and_card(files):
    network = Toy(LayerConfig(5, (2, 3)))
    files.save(files.shipped / "one.safetensors", network, CARD)
    for weights in ("one", files.shipped / "one.safetensors"):
        found, card = files.load(weights)
        assert (found.config, card) == (network.config, CARD)
        assert not any(parameter.requires_grad for parameter in found.parameters())
        expected = rounded(network.state_dict())
        assert all(torch.equal(value, expected[name]) for name, value in found.state_dict().items())
    beside = json.loads((files.shipped / "one.json").read_text())
    assert beside == {"network": {"size": 5, "stretch": [2, 3]}, **CARD}


def test_weights_that_are_not_there_or_of_something_else_are_refused(files):
    with pytest.raises(InputError, match="toy weights enormous: none of that name"):
        files.load("enormous")
    with pytest.raises(InputError, match="no such file"):
        files.load(files.shipped / "weights.safetensors")
    other = torch.nn.Linear(1, 1)
    other.config = LayerConfig()
    files.save(files.shipped / "other.safetensors", other, CARD)
    with pytest.raises(InputError, match="no toy network of this version"):
        files.load("other")


@pytest.mark.parametrize(
    ("files", "config", "most"),
    [(enhancement.FILES, SMALL, 15e6), (attention.FILES, SMALL_GENERATOR, 5e6)],
    ids=["enhancement", "raindrop attention"],
)
def test_what_is_shipped_is_small_and_says_what_it_is(files, config, most):
    network, card = files.load("small")
    path = files.find("small")
    assert path.stat().st_size < most
    assert network.config == config
    assert {"data", "steps", "held out", "validation"} <= set(card)
    beside = json.loads(path.with_suffix(".json").read_text())
    assert {name: value for name, value in beside.items() if name != files.part} == card
