"""Enhancing pictures in tiles; what is shipped does what its card says, on a photograph that it has never seen."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from skimage import data
from tiny_network import TINY

from deraings.enhancement.architecture.network import EnhancementNetwork, NetworkConfig
from deraings.enhancement.enhance import enhance, predict, spans
from deraings.enhancement.weights import Enhancer
from hydroviews.metrics import psnr
from hydroviews.pairs.recipes.panes import draw_pane
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.streaks.recipe import composite, draw_pattern, streak_layer
from hydroviews.scene.images import Image, resize_area, to_linear, to_srgb
from hydroviews.scene.seeds import generator


def untrained_enhancer(config: NetworkConfig = TINY) -> Enhancer:
    return Enhancer(EnhancementNetwork(config).requires_grad_(False), {}, "for a test")


def picture(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((height, width, 3)).astype(np.float32)


@pytest.mark.parametrize("size", [1, 40, 64, 65, 100, 500, 1001])
def test_tiles_cover_everything_and_overlap(size):
    parts = spans(size, 64, 16)
    assert (parts[0][0], parts[-1][1]) == (0, size)
    assert all(end - start == min(64, size) for start, end in parts)
    assert all(one[1] - other[0] >= 16 for one, other in pairwise(parts))
    with pytest.raises(ValueError, match="overlap"):
        spans(100, 16, 16)


@pytest.mark.parametrize("size", [(1, 1), (7, 93), (64, 64), (150, 90)])
def test_tiles_of_an_untrained_network_add_up_to_the_picture(size):
    image = picture(*size)
    np.testing.assert_allclose(enhance(image, untrained_enhancer(), tile=64, overlap=16), image, atol=1e-6)


class Mean(torch.nn.Module):
    """Answers every tile with its own mean."""

    device = torch.device("cpu")

    multiple = 1
    config = NetworkConfig()  # which looks for no mist

    def refine(self, batch, fine):
        return batch.mean().expand_as(batch)


def test_tiles_are_blended_without_a_seam():
    ramp = np.linspace(0, 1, 160, dtype=np.float32)[:, None, None].repeat(64, 1).repeat(3, 2)
    enhanced = enhance(ramp, Enhancer(Mean(), {}, "for a test"), tile=96, overlap=32)[:, 0, 0]
    assert enhanced[[0, -1]] == pytest.approx([ramp[:96].mean(), ramp[64:].mean()], abs=1e-5)
    between = np.diff(enhanced)
    assert between.min() > -1e-6
    assert between.max() < 1.1 * (enhanced[-1] - enhanced[0]) / 33


@pytest.mark.parametrize("broken", [np.zeros((4, 4), np.float32), np.full((4, 4, 3), np.nan, np.float32)])
def test_what_is_no_picture_is_refused(broken):
    with pytest.raises(ValueError, match=r"expected an image|not finite"):
        enhance(broken, untrained_enhancer())


def test_the_cover_comes_with_the_same_picture_from_networks_that_tell_it():
    image, enhancer = picture(50, 70), untrained_enhancer(replace(TINY, error=True))
    torch.nn.init.normal_(enhancer.network.head[0].weight, std=0.001)  # so that it changes pictures
    enhanced, cover, error = predict(image, enhancer)
    np.testing.assert_array_equal(enhanced, enhance(image, enhancer))
    assert np.abs(enhanced - image).max() > 0.01
    assert (enhanced.dtype, enhanced.min() >= 0, enhanced.max() <= 1) == (np.float32, True, True)
    assert cover.shape == image.shape
    assert 0 <= cover.min() < cover.max() <= 1
    assert error.shape == image.shape[:2]
    assert error.min() > 0
    mute = Enhancer(EnhancementNetwork(replace(enhancer.network.config, cover=(), error=False)), {}, "for a test")
    assert predict(image, mute)[1:] == (None, None)


@pytest.fixture(scope="module")
def photograph() -> Image:
    return resize_area((data.astronaut() / 255).astype(np.float32)[:384], 400, 300)


def gained(rainy, photograph):
    """Mean decibels that rainy pictures gain."""
    return np.mean([psnr(enhance(picture), photograph) - psnr(picture, photograph) for picture in rainy])


@pytest.mark.parametrize("grade", [1, 2])
def test_streaks_are_taken_out(photograph, grade):
    pattern = draw_pattern(generator(0, "streaks", grade), grade)
    rainy = composite(photograph, streak_layer(pattern, 400, 300, generator(1)), pattern.brightness)
    assert gained([rainy], photograph) > 3.5


def test_thick_mist_is_taken_off(photograph):
    pattern = replace(drops_pattern.draw_pattern(generator(0, "mist")), mist=0.5)
    veil = mist_veil(pattern, 400, 300, 0.5)[..., None]
    rainy = to_srgb((1 - veil) * to_linear(photograph) + veil * np.float32(0.6))
    assert gained([rainy], photograph) > 3


def test_a_clean_photograph_stays_clean(photograph):
    assert psnr(enhance(photograph), photograph) > 37


def test_small_drops_of_a_window_are_taken_out(photograph):
    panes = [draw_pane(generator(seed, "pane"), 400, 300, has_mist=False) for seed in range(12)]
    rainy = [pane.over(photograph) for pane in panes if 0.05 < pane.cover.mean() < 0.3]
    assert len(rainy) > 3
    assert gained(rainy, photograph) > 2
