from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_attention import GENERATOR, TRAINING
from tiny_supervised import INTERVALS
from wet import lens, photograph

from baselines.derain_nerf.raindrop_attention.config import LossConfig
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import Batch, Patches, ValidationPicture, without_drops
from baselines.derain_nerf.raindrop_attention.training import AttentionTraining
from baselines.derain_nerf.raindrop_attention.validation import as_columns, scores, table
from baselines.supervised.training import train
from baselines.supervised.validation import as_json, average_precision
from hydroviews.pairs.rainy_pairs import DrawnRain


def drawn():
    return DrawnRain([{96: photograph()}], {(96, 64): (lens(),)}, {"raindrop": 1.0})


def learn(folder, config=TRAINING, kind=Patches):
    training = AttentionTraining(config)
    patches = kind(drawn(), config.patch, config.crops, config.batch, config.seed)
    train(training, patches, folder, "drops", lambda _: {}, INTERVALS)
    return training


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
    assert {"attention", "discriminator"} <= training.losses.keys()


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
