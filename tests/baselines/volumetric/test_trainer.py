"""Training of plain fields: what it must reach, and that interruptions leave no trace."""

from dataclasses import replace

import balls
import numpy as np
import pytest
import torch
from balls import SMALL, photographed

from baselines.training.checkpoints import CHECKPOINT
from baselines.training.images import TrainingImages
from baselines.volumetric import model
from baselines.volumetric.config import MlpFieldConfig
from baselines.volumetric.model import RadianceModel
from baselines.volumetric.trainer import rate_at, train
from hydroviews.errors import InputError
from hydroviews.scene.images import to_uint8

SHORT = replace(SMALL, iterations=30, rays=64, anneal=10)


def fit(scene, config, folder, **extras):
    return train(scene, config, 0, folder, lambda s, g, _: RadianceModel(config, s, g), **extras)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return photographed(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def undisturbed(scene, tmp_path_factory):
    return fit(scene, SHORT, tmp_path_factory.mktemp("run"))


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_a_ball_is_learned(scene, tmp_path, monkeypatch, device):
    if device == "cuda" and not torch.cuda.is_available():
        pytest.skip("needs an NVIDIA GPU")
    monkeypatch.setenv("HYDROVIEWS_DEVICE", device)
    trained = fit(scene, SMALL, tmp_path)
    assert trained.device == (torch.cuda.get_device_name() if device == "cuda" else "cpu")
    assert balls.psnr(trained.model.render, scene.train_views) > 24
    assert balls.psnr(trained.model.render, scene.test_views) > 21.5


def test_the_network_of_the_papers_learns_too(scene, tmp_path):
    field = MlpFieldConfig(width=32, depth=4, position_octaves=4, rate=1e-2)
    config = replace(SMALL, field=field, iterations=150, rays=128, proposal_samples=16)
    trained = fit(scene, config, tmp_path)
    mean = np.mean([view.image() for view in scene.train_views], axis=0)
    assert balls.psnr(trained.model.render, scene.test_views) > 1 + balls.psnr(lambda _: mean, scene.test_views)


def test_bad_input_is_refused(scene, tmp_path):
    with pytest.raises(InputError, match="no training views"):
        fit(replace(scene, split=replace(scene.split, train=())), SHORT, tmp_path)
    for weights in ([np.ones((24, 32), np.float32)], [np.full((24, 32), 1.5, np.float32) for _ in scene.train_views]):
        with pytest.raises(InputError, match="weights of the pixels"):
            fit(scene, SHORT, tmp_path, weights=weights)
    (tmp_path / CHECKPOINT).write_bytes(b"nothing")
    with pytest.raises(InputError, match="damaged"):
        fit(scene, SHORT, tmp_path)


@pytest.mark.parametrize("masked", [0, 10])  # the rest is the method's doing
def test_where_a_method_hides_what_masks_do_not_it_is_told(scene, tmp_path, masked):
    pictures = [to_uint8(view.image()) for view in scene.train_views]
    mask = np.broadcast_to(np.arange(32) < masked, (24, 32)) if masked else None
    weights = [np.zeros((24, 32), np.float32) for _ in pictures]
    with pytest.raises(InputError, match=r"no pixel counts\n.*weights of the method itself"):
        fit(scene, SHORT, tmp_path, images=TrainingImages(pictures, [mask] * len(pictures)), weights=weights)


@pytest.mark.parametrize(("step", "rate"), [(0, 0.1), (500, 0.1), (1000, 0.01)])
def test_rates_rise_and_fall(step, rate):
    assert rate_at(step, replace(SMALL, iterations=1000, warm_up=10, final_rate=0.01)) == pytest.approx(rate)


def test_memory_does_not_grow_with_the_picture(undisturbed, monkeypatch):
    view = balls.camera(37, 23)
    whole = undisturbed.model.render(view)
    assert (whole.shape, whole.dtype) == ((23, 37, 3), np.float32)
    monkeypatch.setattr(model, "CHUNK", 48 * 100)
    np.testing.assert_allclose(undisturbed.model.render(view), whole, atol=1e-5)
