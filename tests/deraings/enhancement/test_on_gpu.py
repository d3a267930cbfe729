"""The network on a GPU: pretended, where every tensor has to be in its place, and real, where there is one."""

import numpy as np
import pytest
import torch
from tiny_network import TINY

from baselines.supervised.config import Intervals
from baselines.supervised.training import train
from baselines.training.images import TrainingImages
from deraings.enhancement.architecture.lens_statistics import COARSE, FINE
from deraings.enhancement.architecture.lenses import lenses_of_capture
from deraings.enhancement.enhance import enhance, predict
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.pairs import Batches, Sample
from deraings.enhancement.training.training import EnhancementTraining
from deraings.enhancement.weights import load_enhancer


@pytest.fixture(params=["pretended", "real"])
def on_gpu(request, monkeypatch):
    if request.param == "pretended":
        request.getfixturevalue("pretended_gpu")
    elif not torch.cuda.is_available():
        pytest.skip("needs an NVIDIA GPU")
    monkeypatch.delenv("HYDROVIEWS_DEVICE")


class Noise:
    """Samples of no rain in particular."""

    def __getitem__(self, index):
        chance = torch.Generator().manual_seed(index)
        shapes = {"rainy": (3, 32, 32), "clean": (3, 32, 32), "cover": (3, 32, 32), "box": (4,)}
        shapes |= {"whole_rainy": (2, 3, 128, 128), "whole_clean": (2, 3, 128, 128), "whole_mist": (2, 4, 128, 128)}
        shapes |= {"coarse": (2, COARSE, 16, 16), "fine": (FINE, 16, 16)}
        return Sample(**{name: torch.rand(shape, generator=chance) for name, shape in shapes.items()})


def test_it_learns_the_same(on_gpu, tmp_path):
    config = TrainingConfig(network=TINY, steps=2, batch=1, patch=32, warm_up=1)
    learned = [EnhancementTraining(config, device) for device in ("cpu", "cuda")]
    for training in learned:
        folder = tmp_path / training.device.type
        train(training, Batches(Noise(), 1), folder, "noise", lambda _: {}, Intervals())
    here, there = ([value.cpu() for value in training.averaged.state_dict().values()] for training in learned)
    assert learned[1].device.type == "cuda"
    for ours, theirs in zip(here, there, strict=True):
        assert torch.allclose(ours, theirs, atol=2e-3)


def test_it_makes_the_same_pictures(on_gpu):
    photographs = np.random.default_rng(0).integers(0, 256, (3, 40, 56, 3), np.uint8)
    images = TrainingImages(list(photographs))
    made = []
    for device in ("cpu", "auto"):
        enhancer = load_enhancer(device=device)
        lens = lenses_of_capture(len(images), images.pixels, enhancer.network)[0]
        picture = photographs[0].astype(np.float32) / 255
        made.append((enhancer.network.device.type, enhance(picture, enhancer, tile=48, overlap=16, lens=lens)))
        predict(picture, enhancer, lens=lens)
    (here, ours), (there, theirs) = made
    assert (here, there) == ("cpu", "cuda")
    assert np.abs(ours - theirs).max() < 1e-3
    assert np.abs(ours - picture).max() > 1e-2
