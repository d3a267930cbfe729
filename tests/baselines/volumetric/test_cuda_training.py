"""Radiance fields on an NVIDIA GPU: trained, interrupted, resumed, saved and rendered."""

from dataclasses import replace

import balls
import numpy as np
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


def test_an_interrupted_training_goes_on(tmp_path, monkeypatch):
    scene, config = photographed(tmp_path / "scene"), replace(SMALL, iterations=60, checkpoint_seconds=0.0)
    whole = fit(scene, config, tmp_path / "whole")
    step, done = torch.optim.Adam.step, []

    def interrupted(*given, **named):
        done.append(0)
        if len(done) == 30:
            raise KeyboardInterrupt
        return step(*given, **named)

    monkeypatch.setattr(torch.optim.Adam, "step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fit(scene, config, tmp_path / "halves")
    monkeypatch.setattr(torch.optim.Adam, "step", step)
    halves = fit(scene, config, tmp_path / "halves")
    views = scene.test_views
    assert balls.psnr(halves.model.render, views) == pytest.approx(balls.psnr(whole.model.render, views), abs=0.5)
    assert all(np.isfinite(halves.model.render(view.camera)).all() for view in views)
