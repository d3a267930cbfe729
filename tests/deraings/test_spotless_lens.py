import numpy as np
import pytest

from baselines.encoders.frozen import frozen
from baselines.masking.feature_network import MaskNetwork, MaskNetworkConfig
from baselines.masking.residuals import BINS
from baselines.masking.trimmed import TrimConfig
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.training.images import TrainingImages
from deraings.spotless_lens import LensMask

SPLATTING = TrainerConfig(
    iterations=16, sh_degree=0, strategy=DefaultStrategy(start=99), device="cpu", checkpoint_seconds=0.0
)
NETWORK = MaskNetworkConfig("vgg", octaves=4)


def lens_mask(images):
    return LensMask(images, TrimConfig(), SPLATTING, MaskNetwork(images, frozen("vgg", "cpu"), NETWORK, 0, 1), 0)


def photographs(hidden=()):
    pictures = [np.random.default_rng(k).integers(0, 255, (32, 48, 3), np.uint8) for k in range(3)]
    return TrainingImages(pictures, hidden)


def test_the_network_sees_what_other_views_miss_at_the_same_place():
    ours = lens_mask(photographs())
    drop = np.full((32, 48), 0.01, np.float32)
    drop[8:16, 8:16] = 0.5
    ours.histogram.observe(np.full((32, 48), 0.0195, np.float32))
    limit = 196 / BINS
    assert not ours.context(0)[0].any()  # nothing is known of others
    ours.probability(drop, 0, None)
    ours.probability(np.full_like(drop, 0.9), 1, None)
    (plane,) = ours.context(1)  # its own residuals are not shown
    assert plane.shape == (8, 12)
    assert plane[2:4, 2:4] == pytest.approx(np.log2((0.5 + limit) / (2 * limit)), rel=1e-4)
    assert plane[6, 6] == pytest.approx(np.log2((0.01 + limit) / (2 * limit)), rel=1e-4)


def test_what_is_hidden_says_nothing_to_other_views():
    hidden = np.zeros((32, 48), bool)
    hidden[8:16, 8:16] = True
    ours = lens_mask(photographs([hidden, None, None]))
    ours.histogram.observe(np.full((32, 48), 0.0195, np.float32))
    ours.probability(np.where(hidden, np.float32(0.5), np.float32(0.0196)), 0, hidden)
    (plane,) = ours.context(1)
    assert np.abs(plane).max() < 0.01  # log2 of the inliers' limit over itself


def test_asking_what_is_left_out_changes_nothing():
    images, render = photographs(), np.full((32, 48, 3), 0.2, np.float32)
    ours = lens_mask(images)
    rule = Objective(images, pixel_weights=ours)
    for view in (0, 1):
        rule(render, view, view, BufferPool())
    before = {name: array.copy() for name, array in ours.state_dict().items()}
    for view in range(3):  # of the last one nothing was learned yet
        ours.hidden(view, (32, 48), lambda: render / 2)
    after = ours.state_dict()
    assert after.keys() == before.keys()
    assert [name for name, array in before.items() if array.tobytes() != after[name].tobytes()] == []
