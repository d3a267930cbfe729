"""The training of networks from pairs: its numbers and files, and that nothing which disturbs it changes the result."""

import csv
import json
import math
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from tiny_supervised import CONFIG, Darker, LayerConfig, Toy, ToyTraining, learn, weights_of

from baselines.derain_nerf.raindrop_attention import weights as attention
from baselines.derain_nerf.raindrop_attention.config import SMALL_GENERATOR
from baselines.derain_nerf.raindrop_attention.config import TrainingConfig as AttentionConfig
from baselines.supervised.commands import use_threads
from baselines.supervised.config import Intervals
from baselines.supervised.training import CURVE, rate_at
from baselines.supervised.weights import NetworkFiles, rounded
from baselines.training.checkpoints import CHECKPOINT
from deraings.enhancement import weights as enhancement
from deraings.enhancement.architecture.network import SMALL
from deraings.enhancement.training.config import TrainingConfig
from hydroviews.errors import InputError


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The folder of a training that nothing disturbed, and the training."""
    folder = tmp_path_factory.mktemp("undisturbed")
    return folder, learn(folder)


@pytest.fixture
def finished(undisturbed, tmp_path):
    """Its folder again, for the test to change."""
    return Path(shutil.copytree(undisturbed[0], tmp_path / "finished"))


def test_a_network_learns_and_its_average_follows(tmp_path):
    training = learn(tmp_path, replace(CONFIG, steps=150, averaging=0.9))
    rainy, clean = Darker(CONFIG)[0]
    with torch.no_grad():
        assert (training.averaged(rainy) - clean).abs().mean() < 0.1
    assert training.losses["loss"] < 0.1


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_an_interrupted_training_ends_with_the_same_bits(tmp_path, precision):
    config = replace(CONFIG, precision=precision)
    whole = learn(tmp_path / "whole", config)
    with pytest.raises(KeyboardInterrupt):
        learn(tmp_path / "parts", config, until=4)
    parts = learn(tmp_path / "parts", config)
    assert parts.iteration == whole.iteration == 6
    assert torch.equal(weights_of(whole), weights_of(parts))
    assert whole.losses == parts.losses


def test_workers_do_not_change_the_result_and_another_seed_does(undisturbed, tmp_path):
    expected = weights_of(undisturbed[1])
    assert torch.equal(expected, weights_of(learn(tmp_path / "helped", workers=2)))
    assert torch.equal(expected, weights_of(learn(tmp_path / "0", replace(CONFIG, seed=0))))
    assert not torch.equal(expected, weights_of(learn(tmp_path / "1", replace(CONFIG, seed=1))))


def test_a_finished_training_has_a_row_a_validation_and_is_not_trained_again(undisturbed, finished):
    assert torch.equal(weights_of(undisturbed[1]), weights_of(learn(finished, until=0)))
    rows = list(csv.DictReader((finished / CURVE).open()))
    assert [int(row["step"]) for row in rows] == [3, 6]
    assert [float(row["score"]) for row in rows] == [0, 1]
    assert all(float(row["loss"]) > 0 for row in rows)


def test_a_checkpoint_of_another_training_or_a_damaged_one_is_refused(finished):
    for changed in ({"config": replace(CONFIG, rate=1.0)}, {"data": "others"}):
        with pytest.raises(InputError, match="another run"):
            learn(finished, **changed)
    (finished / CHECKPOINT).write_bytes((finished / CHECKPOINT).read_bytes()[:1000])
    with pytest.raises(InputError, match="damaged"):
        learn(finished)


def test_the_rate_rises_and_falls():
    config = replace(CONFIG, steps=100, warm_up=10, rate=1.0)
    rates = [rate_at(step, config) for step in range(100)]
    assert [rates[step] for step in (0, 9, 55)] == pytest.approx([0.1, 1, 0.5], abs=1e-3)
    assert rates[-1] < 1e-3
    assert all(one >= other for one, other in pairwise(rates[9:]))


def test_a_gradient_that_is_not_finite_changes_no_weights():
    training = ToyTraining(CONFIG)
    before, batch = weights_of(training), Darker(CONFIG)[0]
    with pytest.raises(FloatingPointError, match="network's gradient of iteration 0 is not finite: loss"):
        training.learn(batch._replace(rainy=batch.rainy * torch.inf))
    assert torch.equal(weights_of(training), before)


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
    other = torch.nn.Linear(1, 1)
    other.config = LayerConfig()
    files.save(files.shipped / "other.safetensors", other, CARD)
    for weights, message in (
        ("enormous", "toy weights enormous: none of that name"),
        (files.shipped / "weights.safetensors", "no such file"),
        ("other", "no toy network of this version"),
    ):
        with pytest.raises(InputError, match=message):
            files.load(weights)


@pytest.mark.parametrize(
    ("files", "config", "most"),
    [(enhancement.FILES, SMALL, 15e6), (attention.FILES, SMALL_GENERATOR, 5e6)],
    ids=["enhancement", "raindrop attention"],
)
def test_what_is_shipped_is_small_and_says_what_it_is(files, config, most):
    (network, card), path = files.load("small"), files.find("small")
    assert path.stat().st_size < most
    assert network.config == config
    assert {"data", "steps", "held out", "validation"} <= set(card)
    beside = json.loads(path.with_suffix(".json").read_text())
    assert {name: value for name, value in beside.items() if name != files.part} == card


@pytest.mark.parametrize("config", [TrainingConfig, AttentionConfig])
@pytest.mark.parametrize(
    ("name", "value"), [("steps", 0), ("steps", -1), ("seed", -1), ("batch", 0), ("rate", math.nan), ("rate", -1e-3)]
)
def test_numbers_that_no_training_can_have(config, name, value):
    with pytest.raises(InputError, match=f"--{name} {value}: impossible"):
        config(**{name: value})


def test_intervals_and_threads():
    with pytest.raises(InputError, match="--checkpoint-seconds inf: impossible"):
        Intervals(checkpoint_seconds=math.inf)
    with pytest.raises(InputError, match="--validate-every 0: impossible"):
        Intervals(validate_every=0)
    with pytest.raises(InputError, match="--threads -1: impossible"):
        use_threads(-1)
