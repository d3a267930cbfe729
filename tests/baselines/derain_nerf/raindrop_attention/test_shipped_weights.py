"""What is shipped does what its card says, on a photograph that it has never seen."""

import json

import numpy as np
import pytest
from skimage import data

from baselines.derain_nerf.raindrop_attention.config import SMALL_GENERATOR
from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.weights import FILES, load_detector
from baselines.supervised.validation import average_precision
from hydroviews.pairs.drawing import draw_rain
from hydroviews.pairs.lens_pool import bake_lens
from hydroviews.scene.images import resize_area, to_uint8
from hydroviews.scene.seeds import generator

MOST_BYTES = 5e6
FRAME = 384, 256


@pytest.fixture(scope="module")
def photograph() -> np.ndarray:
    return to_uint8(resize_area((data.astronaut() / 255).astype(np.float32)[:341], *FRAME))


def test_the_shipped_weights_are_small_and_say_what_they_are():
    generator, card = FILES.load("small")
    assert FILES.find("small").stat().st_size < MOST_BYTES
    assert generator.config == SMALL_GENERATOR
    assert {"data", "steps", "training", "held out", "validation"} <= set(card)
    beside = json.loads(FILES.find("small").with_suffix(".json").read_text())
    assert {name: value for name, value in beside.items() if name != "generator"} == card


def test_a_clean_photograph_has_few_drops(photograph):
    found = detect(photograph.astype(np.float32) / 255, load_detector())
    assert (found.attention > 0.5).mean() < 0.05


@pytest.mark.blender
def test_drops_are_found(photograph, tmp_path):
    lens = bake_lens(tmp_path, 77, FRAME, 1)
    rainy, _, cover, *_ = draw_rain(photograph, "raindrop", [lens], generator(77))
    found = detect(rainy, load_detector())
    drops = cover[..., 1] > 0.5
    precision = average_precision(found.attention.ravel(), drops.ravel())
    assert precision > 3 * drops.mean()
    assert precision > 0.35
