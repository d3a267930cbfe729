"""The network on a GPU: pretended, where every tensor has to be in its place, and real, where there is one."""

import numpy as np
import pytest
import torch

from baselines.training.images import TrainingImages
from deraings.enhancement.enhance import enhance, predict
from deraings.enhancement.lenses import lenses_of_capture
from deraings.enhancement.weights import load_enhancer


@pytest.fixture(params=["pretended", "real"])
def on_gpu(request, monkeypatch):
    if request.param == "pretended":
        request.getfixturevalue("pretended_gpu")
    elif not torch.cuda.is_available():
        pytest.skip("needs an NVIDIA GPU")
    monkeypatch.delenv("HYDROVIEWS_DEVICE")


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
