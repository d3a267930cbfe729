"""Radiance fields on an NVIDIA GPU: trained, interrupted, resumed, saved and rendered."""

import balls
import pytest
import torch
from balls import SMALL, photographed

from baselines.volumetric.model import RadianceModel
from baselines.volumetric.trainer import train

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs an NVIDIA GPU")


@pytest.fixture(autouse=True)
def on_the_gpu(monkeypatch):
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda")


def fit(scene, config, folder):
    return train(scene, config, 0, folder, lambda space, generator, _: RadianceModel(config, space, generator))


def test_a_ball_is_learned(tmp_path):
    scene = photographed(tmp_path / "scene")
    trained = fit(scene, SMALL, tmp_path / "run")
    assert trained.device == torch.cuda.get_device_name()
    assert balls.psnr(trained.model.render, scene.test_views) > 21.5
