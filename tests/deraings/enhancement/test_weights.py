"""What is shipped does what its card says, on a photograph that it has never seen."""

from dataclasses import replace

import numpy as np
import pytest
from skimage import data

from deraings.enhancement.enhance import enhance
from hydroviews.metrics import psnr
from hydroviews.pairs.recipes.panes import draw_pane
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.streaks.recipe import composite, draw_pattern, streak_layer
from hydroviews.scene.images import Image, resize_area, to_linear, to_srgb
from hydroviews.scene.seeds import generator


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
