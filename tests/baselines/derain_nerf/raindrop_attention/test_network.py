import numpy as np
import pytest
import torch
from tiny_attention import DISCRIMINATOR, GENERATOR

from baselines.derain_nerf.raindrop_attention.attention import ConvLSTM
from baselines.derain_nerf.raindrop_attention.config import CONFIGS, DiscriminatorConfig, GeneratorConfig
from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.discriminator import Discriminator
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator


def picture(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((height, width, 3)).astype(np.float32)


def random_generator(config: GeneratorConfig = GENERATOR) -> DerainGenerator:
    """Untrained, its outputs not zero."""
    torch.manual_seed(0)
    generator = DerainGenerator(config).eval()
    for parameter in generator.autoencoder.outputs.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    return generator


@pytest.mark.parametrize(("height", "width"), [(37, 53), (48, 64), (1, 1), (3, 130)])
def test_any_size_gives_maps_and_pictures_in_range(height, width):
    found = detect(picture(height, width), random_generator())
    assert found.attention.shape == (height, width)
    assert found.derained.shape == (height, width, 3)
    assert 0 < found.attention.min() <= found.attention.max() < 1
    assert found.derained.min() >= 0
    assert found.derained.max() <= 1


def test_what_is_no_picture_is_refused():
    with pytest.raises(ValueError, match="shape"):
        detect(np.zeros((4, 4), np.float32), random_generator())
    with pytest.raises(ValueError, match="finite"):
        detect(np.full((4, 4, 3), np.nan, np.float32), random_generator())


@pytest.mark.parametrize("stride", [1, 2])
def test_every_look_gives_a_map_and_there_are_three_resolutions(stride):
    config = GeneratorConfig(iterations=3, attention_width=8, attention_blocks=1, attention_stride=stride, width=8)
    maps, frames = DerainGenerator(config)(torch.rand(2, 3, 32, 48))
    assert [tuple(a.shape) for a in maps] == [(2, 1, 32 // stride, 48 // stride)] * 3
    assert [tuple(f.shape[2:]) for f in frames] == [(8, 12), (16, 24), (32, 48)]


def test_small_changes_nothing_before_it_has_learned():
    image = picture(40, 36)
    np.testing.assert_array_equal(detect(image, DerainGenerator(GENERATOR)).derained, image)


def test_the_start_of_the_attention_is_a_half_and_looks_see_the_map_before():
    generator = random_generator()
    seen = []
    generator.attention.start.register_forward_hook(lambda module, inputs, output: seen.append(inputs[0][:, -1:]))
    maps, _ = generator(torch.rand(1, 3, 16, 16))
    assert (seen[0] == 0.5).all()
    assert torch.equal(seen[1], maps[0])


def lstm_by_hand(x, hidden, cell, weight, bias):
    """One step in float64, a pixel at a time."""
    channels, height, width = x.shape
    both = np.pad(np.concatenate([x, hidden]), ((0, 0), (1, 1), (1, 1)))
    sigmoid = lambda v: 1 / (1 + np.exp(-v))  # noqa: E731
    new_hidden, new_cell = np.zeros_like(cell), np.zeros_like(cell)
    for row in range(height):
        for column in range(width):
            window = both[:, row : row + 3, column : column + 3]
            gates = (weight * window).sum(axis=(1, 2, 3)) + bias
            i, f, g, o = gates.reshape(4, channels)
            c = sigmoid(f) * cell[:, row, column] + sigmoid(i) * np.tanh(g)
            new_cell[:, row, column] = c
            new_hidden[:, row, column] = sigmoid(o) * np.tanh(c)
    return new_hidden, new_cell


def test_the_memory_against_a_step_by_hand():
    torch.manual_seed(1)
    memory = ConvLSTM(3)
    x, hidden, cell = (torch.randn(1, 3, 5, 4) for _ in range(3))
    expected = lstm_by_hand(*(a[0].double().numpy() for a in (x, hidden, cell)), *_weights(memory))
    for found, wanted in zip(memory(x, (hidden, cell)), expected, strict=True):
        np.testing.assert_allclose(found[0].detach().numpy(), wanted, atol=1e-6)


def _weights(memory):
    return memory.gates.weight.detach().double().numpy(), memory.gates.bias.detach().double().numpy()


@pytest.mark.parametrize("size", [(32, 32), (36, 64)])
def test_the_discriminator_judges_any_size(size):
    judged = Discriminator(DISCRIMINATOR)(torch.rand(3, 3, *size))
    assert judged.real.shape == (3,)
    assert judged.map.shape == (3, 1, size[0] // 4, size[1] // 4)


def test_the_published_discriminator_has_dense_layers_for_patches_of_224():
    with torch.device("meta"):
        discriminator = Discriminator(DiscriminatorConfig())
        features = torch.zeros(1, 128, 224, 224)
        for layer in discriminator.far:
            features = layer(features)
    assert features.shape[1:] == (32, 14, 14)
    assert discriminator.dense.in_features == 32 * 14 * 14


def test_the_published_configuration_has_its_widths():
    with torch.device("meta"):
        generator = DerainGenerator(CONFIGS["paper"].generator)
    assert generator.attention.iterations == 4
    assert len(generator.attention.blocks) == 5
    assert generator.attention.memory.gates.weight.shape == (4 * 32, 2 * 32, 3, 3)
    assert generator.autoencoder.near_quarter[0].weight.shape == (256, 256, 3, 3)
