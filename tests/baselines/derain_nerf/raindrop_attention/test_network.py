"""The networks that find drops, their losses against their definitions, and their training."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_attention import DISCRIMINATOR, GENERATOR, TRAINING
from tiny_supervised import INTERVALS
from wet import lens, photograph

from baselines.derain_nerf.raindrop_attention.attention import ConvLSTM
from baselines.derain_nerf.raindrop_attention.autoencoder import Frames, frames_of
from baselines.derain_nerf.raindrop_attention.config import CONFIGS, DiscriminatorConfig, GeneratorConfig, LossConfig
from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.discriminator import Discriminator, Judgement
from baselines.derain_nerf.raindrop_attention.losses import (
    adversarial_loss,
    attention_loss,
    discriminator_loss,
    generator_losses,
    perceptual_loss,
    scale_loss,
)
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import Batch, Patches, ValidationPicture, without_drops
from baselines.derain_nerf.raindrop_attention.training import AttentionTraining
from baselines.derain_nerf.raindrop_attention.validation import as_columns, scores, table
from baselines.supervised.training import train
from baselines.supervised.validation import as_json, average_precision
from hydroviews.pairs.rainy_pairs import DrawnRain


def picture(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).random((height, width, 3)).astype(np.float32)


def random_generator() -> DerainGenerator:
    """Untrained, its outputs not zero."""
    generator = DerainGenerator(GENERATOR).eval()
    for parameter in generator.autoencoder.outputs.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    return generator


@pytest.mark.parametrize(("height", "width"), [(37, 53), (48, 64), (1, 1), (3, 130)])
def test_any_size_gives_maps_and_pictures_in_range(height, width):
    image = picture(height, width)
    found = detect(image, random_generator())
    assert (found.attention.shape, found.derained.shape) == ((height, width), (height, width, 3))
    assert 0 < found.attention.min() <= found.attention.max() < 1
    assert 0 <= found.derained.min() <= found.derained.max() <= 1
    untrained = detect(image, DerainGenerator(GENERATOR))  # which changes nothing before it has learned
    np.testing.assert_array_equal(untrained.derained, image)


@pytest.mark.parametrize(("shape", "value", "message"), [((4, 4), 0, "shape"), ((4, 4, 3), np.nan, "finite")])
def test_what_is_no_picture_is_refused(shape, value, message):
    with pytest.raises(ValueError, match=message):
        detect(np.full(shape, value, np.float32), random_generator())


@pytest.mark.parametrize("stride", [1, 2])
def test_every_look_gives_a_map_and_there_are_three_resolutions(stride):
    config = GeneratorConfig(iterations=3, attention_width=8, attention_blocks=1, attention_stride=stride, width=8)
    maps, frames = DerainGenerator(config)(torch.rand(2, 3, 32, 48))
    assert [tuple(a.shape) for a in maps] == [(2, 1, 32 // stride, 48 // stride)] * 3
    assert [tuple(f.shape[2:]) for f in frames] == [(8, 12), (16, 24), (32, 48)]


def test_the_memory_of_a_single_pixel_is_the_cell_of_torch():
    memory, cell = ConvLSTM(3), torch.nn.LSTMCell(3, 3)
    centre = memory.gates.weight[:, :, 1, 1]  # all that a picture of one pixel meets of the kernels
    weights = {"weight_ih": centre[:, :3], "weight_hh": centre[:, 3:]}
    cell.load_state_dict({**weights, "bias_ih": memory.gates.bias, "bias_hh": torch.zeros(12)})
    x, *state = (torch.randn(5, 3) for _ in range(3))
    found = memory(x[..., None, None], tuple(part[..., None, None] for part in state))
    for ours, theirs in zip(found, cell(x, tuple(state)), strict=True):
        assert torch.allclose(ours[..., 0, 0], theirs, atol=1e-6)


@pytest.mark.parametrize("size", [(32, 32), (36, 64)])
def test_the_discriminator_judges_any_size(size):
    judged = Discriminator(DISCRIMINATOR)(torch.rand(3, 3, *size))
    assert judged.real.shape == (3,)
    assert judged.map.shape == (3, 1, size[0] // 4, size[1] // 4)


def test_the_published_configuration_has_its_widths():
    with torch.device("meta"):
        generator, discriminator = DerainGenerator(CONFIGS["paper"].generator), Discriminator(DiscriminatorConfig())
    assert discriminator.dense.in_features == 32 * 14 * 14
    assert generator.attention.iterations == 4
    assert len(generator.attention.blocks) == 5
    assert generator.attention.memory.gates.weight.shape == (4 * 32, 2 * 32, 3, 3)
    assert generator.autoencoder.near_quarter[0].weight.shape == (256, 256, 3, 3)


def test_maps_of_means_of_their_pixels_count_more_the_later_they_are():
    cover = torch.ones(1, 1, 4, 4)
    maps = [torch.full((1, 1, 2, 2), value) for value in (0.5, 0.9, 0.8)]
    assert attention_loss(maps, cover, 0.8).item() == pytest.approx(0.64 * 0.25 + 0.8 * 0.01 + 0.04)
    corner = torch.tensor([[1.0, 0, 0, 0], [0, 0, 0, 0]])[None, None]
    assert attention_loss([torch.tensor([[0.25, 0]])[None, None]], corner, 0.8).item() == 0


def test_scales_are_weighed():
    clean = torch.rand(2, 3, 8, 8)
    away = Frames(*(frame + error for frame, error in zip(frames_of(clean), (0.1, 0.2, 0.3), strict=True)))
    expected = 0.6 * 0.01 + 0.8 * 0.04 + 0.09
    assert scale_loss(away, clean, (0.6, 0.8, 1.0)).item() == pytest.approx(expected, rel=1e-5)


def test_adversaries_agree_with_their_logarithms():
    logits, real = torch.tensor([0.3, -2.0]), torch.tensor([1.5, 0.1])
    fooled = np.mean(np.log(1 - 1 / (1 + np.exp(-logits.double().numpy()))))
    believed = np.mean(np.log(1 / (1 + np.exp(-real.double().numpy()))))
    assert adversarial_loss(logits).item() == pytest.approx(fooled)
    seen = Judgement(logits, torch.full((2, 1, 2, 2), 0.5)), Judgement(real, torch.full((2, 1, 2, 2), 0.2))
    attention = torch.full((2, 1, 8, 8), 0.9)
    expected = -believed - fooled + 0.05 * (0.16 + 0.04)
    assert discriminator_loss(*seen, attention, 0.05).item() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("network", ["alex", "vgg"])
def test_the_same_picture_is_perceived_the_same(network):
    torch.manual_seed(0)
    clean = torch.rand(1, 3, 48, 48)
    assert perceptual_loss(clean, clean, network).item() == 0
    near, far = (perceptual_loss((clean + d).clamp(0, 1), clean, network).item() for d in (0.05, 0.3))
    assert 0 < near < far


@pytest.mark.parametrize("level", [None, 0, 1])
def test_gradients_are_finite_where_nothing_is_to_be_done(level):
    clean = torch.rand(1, 3, 48, 48) if level is None else torch.full((1, 3, 48, 48), float(level))
    generator, discriminator = DerainGenerator(GENERATOR), Discriminator(DISCRIMINATOR)
    found = generator(clean)
    losses = generator_losses(
        found, clean, torch.zeros_like(clean[:, :1]), discriminator(found.frames.whole), TRAINING.losses
    )
    assert losses.scales.item() == losses.perceptual.item() == 0
    losses.total(TRAINING.losses).backward()
    judged = discriminator(found.frames.whole.detach())
    discriminator_loss(judged, discriminator(clean), found.maps[-1].detach(), 0.05).backward()
    gradients = [parameter.grad for network in (generator, discriminator) for parameter in network.parameters()]
    assert all(gradient is not None and torch.isfinite(gradient).all() for gradient in gradients)


def drawn():
    return DrawnRain([{96: photograph()}], {(96, 64): (lens(),)}, {"raindrop": 1.0})


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
    training = AttentionTraining(replace(TRAINING, losses=losses, steps=60, rate=5e-3, averaging=0.9))
    pictures = Bright(drawn(), 32, 1, 1, 0)
    train(training, pictures, tmp_path, "drops", lambda _: {}, INTERVALS)
    rainy, clean, cover = pictures[99]
    with torch.no_grad():
        maps, frames = training.averaged(rainy)
    truth = torch.nn.functional.avg_pool2d(cover, 2) > 0.5
    assert average_precision(maps[-1].numpy().ravel(), truth.numpy().ravel()) > 0.9
    assert (frames.whole - clean).square().mean() < 0.5 * (rainy - clean).square().mean()
    assert {"attention", "discriminator"} <= training.losses.keys()


def test_patches_show_the_cover_of_their_own_place():
    batch, again, other = (Patches(drawn(), 48, 3, 2, seed)[0] for seed in (0, 0, 1))
    assert [part.shape for part in batch] == [(6, 3, 48, 48), (6, 3, 48, 48), (6, 1, 48, 48)]
    assert 0 < batch.cover.mean() < 1
    assert all(torch.equal(a, b) for a, b in zip(batch, again, strict=True))
    assert not torch.equal(batch.rainy, other.rainy)
    assert not without_drops(lens()).matte.mask.any()


def test_average_precision_against_counting():
    truth = np.array([True, False, True, False])
    assert average_precision(np.array([0.9, 0.8, 0.7, 0.1]), truth) == pytest.approx(0.5 * 1 + 0.5 * 2 / 3)
    assert average_precision(np.array([0.9, 0.1, 0.8, 0.1]), truth) == 1
    assert average_precision(np.zeros(4), truth) == 0.5  # all alike: the share of what is true
    with pytest.raises(ValueError, match="nothing"):
        average_precision(np.zeros(2), np.zeros(2, bool))


def test_scores_of_a_network_that_changes_nothing():
    clean, cover = np.full((32, 32, 3), 0.5, np.float32), np.zeros((32, 32), np.float32)
    cover[:8] = 1
    pictures = [
        ValidationPicture("drops-light", clean + 0.1, clean, cover),
        ValidationPicture("clean", clean, clean, 0 * cover),
    ]
    drops, dry = scores(DerainGenerator(GENERATOR), pictures)
    assert (drops.before, drops.after, drops.pictures) == (pytest.approx(20, abs=1e-3), pytest.approx(20, abs=1e-3), 1)
    assert np.isnan(dry.precision)
    columns = as_columns([drops, dry])
    assert "clean AP" not in columns
    assert columns["drops-light gain"] == pytest.approx(0, abs=1e-3)
    assert as_json([dry], decimals=4)[0]["before"] is None
    assert "| drops-light | 1 |" in table([drops, dry])
