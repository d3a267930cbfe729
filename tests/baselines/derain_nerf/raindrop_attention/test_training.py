import csv
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_attention import GENERATOR, TRAINING
from wet import lens, photograph

from baselines.derain_nerf.raindrop_attention.config import LossConfig
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import Batch, Patches, ValidationPicture, without_drops
from baselines.derain_nerf.raindrop_attention.training import train
from baselines.derain_nerf.raindrop_attention.validation import as_columns, scores, table
from baselines.derain_nerf.raindrop_attention.weights import load_detector, save_generator
from baselines.training.checkpoints import CHECKPOINT
from baselines.training.network_commands import rounded
from baselines.training.supervised_training import CURVE, Intervals, rate_at
from baselines.training.validation import as_json, average_precision
from hydroviews.errors import InputError
from hydroviews.pairs.rainy_pairs import DrawnRain

INTERVALS = Intervals(checkpoint_seconds=0.0, validate_every=3)


def drawn():
    return DrawnRain([{96: photograph()}], {(96, 64): (lens(),)}, {"raindrop": 1.0})


class Interrupting(Patches):
    """The same patches until step 3."""

    def __getitem__(self, step):
        if step == 3:
            raise KeyboardInterrupt
        return super().__getitem__(step)


def learn(folder, config=TRAINING, kind=Patches, data="drops"):
    patches = kind(drawn(), config.patch, config.crops, config.batch, config.seed)
    return train(folder, config, patches, data, lambda _: {"score": 1.0}, INTERVALS)


def weights_of(training):
    networks = (training.averaged, training.generator, training.discriminator)
    return torch.cat([p.detach().flatten() for network in networks for p in network.parameters()])


def test_patches_show_the_cover_of_their_own_place():
    rainy, clean, cover = Patches(drawn(), 48, 3, 2, 0)[0]
    assert rainy.shape == clean.shape == (6, 3, 48, 48)
    assert cover.shape == (6, 1, 48, 48)
    assert 0 < cover.mean() < 1
    again = Patches(drawn(), 48, 3, 2, 0)[0]
    assert all(torch.equal(a, b) for a, b in zip((rainy, clean, cover), again, strict=True))
    assert not torch.equal(rainy, Patches(drawn(), 48, 3, 2, 1)[0].rainy)
    assert not without_drops(lens()).matte.mask.any()


class Bright(Patches):
    """Drops that are bright squares on darkness."""

    def __getitem__(self, step):
        cover = torch.zeros(4, 1, 32, 32)
        for plane, (top, left) in zip(cover[:, 0], np.random.default_rng(step).integers(0, 20, (4, 2)), strict=True):
            plane[top : top + 12, left : left + 12] = 1
        clean = torch.full((4, 3, 32, 32), 0.2)
        return Batch(clean + 0.6 * cover, clean, cover)


def test_drops_are_learned_and_removed(tmp_path):
    losses = LossConfig(perceptual="alex", perceptual_weight=0, adversarial=0)  # 32 pixels have no texture to judge
    training = learn(tmp_path, replace(TRAINING, losses=losses, steps=60, rate=5e-3, averaging=0.9), Bright)
    rainy, clean, cover = Bright(drawn(), 32, 1, 1, 0)[99]
    with torch.no_grad():
        maps, frames = training.averaged(rainy)
    truth = torch.nn.functional.avg_pool2d(cover, 2) > 0.5
    assert average_precision(maps[-1].numpy().ravel(), truth.numpy().ravel()) > 0.9
    assert (frames.whole - clean).square().mean() < 0.5 * (rainy - clean).square().mean()


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_an_interrupted_training_ends_with_the_same_bits(undisturbed, tmp_path, precision):
    config = replace(TRAINING, precision=precision)
    whole = undisturbed[1] if config == TRAINING else learn(tmp_path / "whole", config)
    with pytest.raises(KeyboardInterrupt):
        learn(tmp_path / "parts", config, Interrupting)
    parts = learn(tmp_path / "parts", config)
    assert parts.iteration == whole.iteration == 6
    assert torch.equal(weights_of(whole), weights_of(parts))
    assert parts.losses == whole.losses


def test_every_seed_is_another_training_and_zero_is_one(undisturbed, tmp_path):
    again, other = (learn(tmp_path / str(seed), replace(TRAINING, seed=seed)) for seed in (0, 1))
    assert torch.equal(weights_of(undisturbed[1]), weights_of(again))
    assert not torch.equal(weights_of(undisturbed[1]), weights_of(other))


@pytest.mark.parametrize("changed", [{"config": replace(TRAINING, rate=1.0)}, {"data": "others"}])
def test_a_checkpoint_of_another_training_is_refused(finished, changed):
    with pytest.raises(InputError, match="another run"):
        learn(finished, **changed)


def test_a_damaged_checkpoint_is_refused(finished):
    (finished / CHECKPOINT).write_bytes((finished / CHECKPOINT).read_bytes()[:1000])
    with pytest.raises(InputError, match="damaged"):
        learn(finished)


def test_the_curve_has_a_row_a_validation(undisturbed):
    rows = list(csv.DictReader((undisturbed[0] / CURVE).open()))
    assert [int(row["step"]) for row in rows] == [3, 6]
    assert {"attention", "discriminator", "score"} <= set(rows[0])


def test_the_rate_rises_and_falls():
    config = replace(TRAINING, steps=100, warm_up=10, rate=1.0, final_rate=0.0)
    assert rate_at(0, config) == pytest.approx(0.1)
    assert rate_at(9, config) == pytest.approx(1.0)
    assert rate_at(55, config) == pytest.approx(0.5)
    assert rate_at(99, config) < 0.001


def test_average_precision_against_counting():
    truth = np.array([True, False, True, False])
    assert average_precision(np.array([0.9, 0.8, 0.7, 0.1]), truth) == pytest.approx(0.5 * 1 + 0.5 * 2 / 3)
    assert average_precision(np.array([0.9, 0.1, 0.8, 0.1]), truth) == 1
    assert average_precision(np.zeros(4), truth) == 0.5  # all alike: the share of what is true
    with pytest.raises(ValueError, match="nothing"):
        average_precision(np.zeros(2), np.zeros(2, bool))


def test_scores_of_a_network_that_changes_nothing():
    clean = np.full((32, 32, 3), 0.5, np.float32)
    cover = np.zeros((32, 32), np.float32)
    cover[:8] = 1
    generator = DerainGenerator(GENERATOR)
    pictures = [
        ValidationPicture("drops-light", clean + 0.1, clean, cover),
        ValidationPicture("clean", clean, clean, 0 * cover),
    ]
    drops, dry = scores(generator, pictures)
    assert (drops.before, drops.after) == (pytest.approx(20, abs=1e-3), pytest.approx(20, abs=1e-3))
    assert drops.pictures == 1
    assert np.isnan(dry.precision)
    assert "clean AP" not in as_columns([drops, dry])
    assert as_columns([drops, dry])["drops-light gain"] == pytest.approx(0, abs=1e-3)
    assert as_json([dry], decimals=4)[0]["before"] is None
    assert "| drops-light | 1 |" in table([drops, dry])


def test_weights_come_back_with_their_card(undisturbed, tmp_path):
    averaged = deepcopy(undisturbed[1].averaged)
    path = tmp_path / "weights.safetensors"
    save_generator(path, GENERATOR, averaged.state_dict(), {"data": "drops"})
    detector = load_detector(path)
    assert detector.card == {"data": "drops"}
    averaged.load_state_dict(rounded(averaged.state_dict()))
    image = torch.rand(1, 3, 32, 32)
    assert torch.equal(detector.generator(image).maps[-1], averaged(image).maps[-1])


def test_weights_that_are_not_there_or_of_something_else_are_refused(tmp_path):
    with pytest.raises(InputError, match="none of that name"):
        load_detector("enormous")
    with pytest.raises(InputError, match="no such file"):
        load_detector(tmp_path / "weights.safetensors")
    save_generator(tmp_path / "other.safetensors", GENERATOR, {"w": torch.zeros(1)}, {})
    with pytest.raises(InputError, match="not a raindrop attention network"):
        load_detector(tmp_path / "other.safetensors")
