"""Training of plain fields: what it must reach, and that interruptions leave no trace."""

from dataclasses import replace

import balls
import numpy as np
import pytest
import torch
from balls import SMALL, photographed

from baselines.training.checkpoints import CHECKPOINT
from baselines.training.images import TrainingImages
from baselines.volumetric.config import MlpFieldConfig
from baselines.volumetric.losses import photometric_losses
from baselines.volumetric.model import RadianceModel
from baselines.volumetric.trainer import rate_at, train
from hydroviews.errors import InputError
from hydroviews.scene.images import to_uint8, write_png

SHORT = replace(SMALL, iterations=30, rays=64, proposal_always=10)


def fit(scene, config, folder, seed=0, loss=None, **extras):
    return train(scene, config, seed, folder, lambda s, g, _: RadianceModel(config, s, g), loss, **extras)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return photographed(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def undisturbed(scene, tmp_path_factory):
    return fit(scene, SHORT, tmp_path_factory.mktemp("run"))


def assert_identical(one, two):
    for (name, values), others in zip(one.model.state_dict().items(), two.model.state_dict().values(), strict=True):
        assert torch.equal(values, others), name


def disturbed(config, at, action):
    """The plain loss, which does something at one call."""
    calls = []

    def loss(rendering, batch):
        calls.append(0)
        if len(calls) == at:
            action()
        return photometric_losses(config)(rendering, batch)

    return loss


def test_a_ball_is_learned(scene, tmp_path):
    trained = fit(scene, SMALL, tmp_path)
    assert balls.psnr(trained.model.render, scene.train_views) > 24
    assert balls.psnr(trained.model.render, scene.test_views) > 21.5


def test_the_network_of_the_papers_learns_too(scene, tmp_path):
    field = MlpFieldConfig(width=32, depth=4, skip=2, position_octaves=4, direction_octaves=1, rate=1e-2)
    config = replace(SMALL, field=field, iterations=150, rays=128, proposal_samples=16)
    trained = fit(scene, config, tmp_path)
    mean = np.mean([view.image() for view in scene.train_views], axis=0)
    assert balls.psnr(trained.model.render, scene.test_views) > 1 + balls.psnr(lambda _: mean, scene.test_views)


def test_the_same_seed_gives_the_same_bits(scene, undisturbed, tmp_path):
    assert_identical(undisturbed, fit(scene, SHORT, tmp_path / "same"))
    other = fit(scene, SHORT, tmp_path / "other", seed=1)
    assert not torch.equal(other.model.field.inner.weight, undisturbed.model.field.inner.weight)


@pytest.mark.parametrize("iteration", [1, 11, 24])
def test_a_crash_leaves_no_trace(scene, undisturbed, tmp_path, iteration):
    def crash():
        raise RuntimeError("power cut")

    config = replace(SHORT, checkpoint_seconds=0.0)
    with pytest.raises(RuntimeError, match="power cut"):
        fit(scene, config, tmp_path, loss=disturbed(config, iteration, crash))
    assert_identical(undisturbed, fit(scene, config, tmp_path))


def test_a_loss_that_is_not_finite_ends_the_training_before_it_is_learned(scene, undisturbed, tmp_path):
    plain, calls = photometric_losses(SHORT), []

    def loss(rendering, batch):
        calls.append(0)
        return plain(rendering, batch) | ({"bias": rendering.colour.sum() / 0} if len(calls) == 9 else {})

    config = replace(SHORT, checkpoint_seconds=0.0)
    with pytest.raises(FloatingPointError, match=r"iteration 8 is not finite: colour [0-9.]+.*bias (inf|nan)"):
        fit(scene, config, tmp_path, loss=loss)
    assert_identical(undisturbed, fit(scene, config, tmp_path))


@pytest.mark.parametrize("change", ["configuration", "seed", "images", "weights", "settings"])
def test_a_checkpoint_of_another_run_is_refused(scene, tmp_path, change):
    config, seed, extras = replace(SHORT, iterations=2), 0, {}
    fit(scene, config, tmp_path)
    if change == "configuration":
        config = replace(config, samples=8)
    elif change == "seed":
        seed = 1
    elif change == "settings":
        extras["settings"] = {"share": 0.5}
    elif change == "weights":
        extras["weights"] = [np.full((24, 32), 0.5, np.float32) for _ in scene.train_views]
    else:
        view = scene.train_views[0]
        write_png(tmp_path / "other.png", 1 - view.image())
        views = tuple(replace(v, path=tmp_path / "other.png") if v is view else v for v in scene.views)
        scene = replace(scene, views=views)
    with pytest.raises(InputError, match="configuration" if change == "settings" else change):
        fit(scene, config, tmp_path, seed, **extras)


def test_pixels_of_weight_zero_leave_no_trace(scene, tmp_path):
    weights = [np.ones((24, 32), np.float32) for _ in scene.train_views]
    for weight in weights:
        weight[8:16, 10:20] = 0
    trained = []
    for take, seed in (("one", 1), ("two", 2)):
        noise, views = np.random.default_rng(seed), []
        for view in scene.views:
            pixels = view.image()
            pixels[8:16, 10:20] = noise.random((8, 10, 3))
            write_png(tmp_path / take / view.path.name, pixels)
            views.append(replace(view, path=tmp_path / take / view.path.name))
        changed = replace(scene, views=tuple(views))
        trained.append(fit(changed, SHORT, tmp_path / f"run-{take}", weights=weights))
    assert_identical(*trained)


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
    mask = np.broadcast_to(np.arange(32) < masked, (24, 32))
    pictures = [to_uint8(view.image()) for view in scene.train_views]
    images = TrainingImages(pictures, [mask if masked else None for _ in pictures])
    weights = [np.zeros((24, 32), np.float32) for _ in pictures]
    with pytest.raises(InputError, match=r"no pixel counts\n.*weights of the method itself"):
        fit(scene, SHORT, tmp_path, images=images, weights=weights)


def test_rates_rise_and_fall():
    config = replace(SMALL, iterations=1000, warm_up=10, final_rate=0.01)
    assert rate_at(0, config) == pytest.approx(0.1)
    assert rate_at(500, config) == pytest.approx(0.1)
    assert rate_at(1000, config) == pytest.approx(0.01)


def test_memory_does_not_grow_with_the_picture(undisturbed, monkeypatch):
    from baselines.volumetric import model

    view = balls.camera(37, 23)
    whole = undisturbed.model.render(view)
    monkeypatch.setattr(model, "CHUNK", 48 * 100)
    np.testing.assert_allclose(undisturbed.model.render(view), whole, atol=1e-5)
    assert whole.shape == (23, 37, 3)
    assert whole.dtype == np.float32
