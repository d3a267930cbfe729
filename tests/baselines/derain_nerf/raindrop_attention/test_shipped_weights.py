"""What is shipped does what its card says, on a photograph that it has never seen."""

import numpy as np
import pytest
from skimage import data

from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.weights import load_detector
from baselines.supervised.validation import average_precision
from hydroviews.pairs.drawing import draw_rain
from hydroviews.pairs.lens_pool import bake_lens
from hydroviews.scene.images import resize_area, to_uint8
from hydroviews.scene.seeds import generator

FRAME = 384, 256


@pytest.fixture(scope="module")
def photograph() -> np.ndarray:
    return to_uint8(resize_area((data.astronaut() / 255).astype(np.float32)[:341], *FRAME))


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
