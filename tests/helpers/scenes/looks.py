"""Photographs in which one scene looks different, and trainings of Gaussians whose colours are made of photographs."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from splats import BACKGROUND, cloud, photographed
from torch.nn.modules.module import register_module_forward_pre_hook

from baselines.splatting.appearance.gaussians import with_appearance
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.config import TrainerConfig
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import StepOptions
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting_profiles import SHORT_RATES
from baselines.training.images import read_images
from baselines.training.torch_state import torch_threads
from baselines.wild_gs.config import SHORT as LOOK
from hydroviews.metrics.psnr import psnr
from hydroviews.scene.images import write_png

SPLATTING = TrainerConfig(
    iterations=300,
    sh_degree=1,
    sh_degree_interval=50,
    learning_rates=SHORT_RATES,
    strategy=DefaultStrategy(start=999),
    device="cpu",
)
GROWING = replace(SPLATTING, iterations=12, strategy=DefaultStrategy(start=3, stop=11, every=4, grow_grad2d=1e-7))
# Wild-GS for a tenth of the iterations, and small pictures, which are looked at as they are.
BRIEF = replace(
    LOOK,
    shrink=1,
    side=32,
    box=1.8,
    renewed=50,
    rate_encoder=5e-3,
    rate_networks=2e-3,
    rate_intrinsic=1e-2,
    visible_from=0.05,
)
# Light differs and nothing comes and goes: masks would take casts for that.
LIGHT = replace(BRIEF, absent=0.0, visible_from=2.0)


def true_pictures(scene):
    return {view.name: view.image() for view in scene.views}


def all_grey(scene):
    """Training photographs of one colour."""
    for view in scene.train_views:
        write_png(view.path, np.full((view.camera.height, view.camera.width, 3), 0.4, np.float32))
    return scene


def cast(scene):
    """Every photograph with a gain of its own in each channel."""
    rng = np.random.default_rng(1)
    for view in scene.train_views:
        write_png(view.path, np.clip(view.image() * np.exp(rng.normal(-0.5, 0.4, 3)).astype(np.float32), 0, 1))


def occlude(scene, side=24):
    """A bright block somewhere in every third photograph."""
    rng = np.random.default_rng(0)
    for view in scene.train_views[::3]:
        image = view.image()
        top, left = rng.integers(0, image.shape[0] - side + 1), rng.integers(0, image.shape[1] - side + 1)
        image[top : top + side, left : left + side] = (1, 0.9, 0.2)
        write_png(view.path, image)


def threads_of_networks(kind, config, folder):
    """The numbers of threads that networks ran with, of three, in a method's training, a render and a mask."""
    scene, seen = photographed(folder, n_views=6), set()
    noting = register_module_forward_pre_hook(lambda module, inputs: seen.add(torch.get_num_threads()))
    try:
        with torch_threads(3):
            method = kind(config, 0)
            method.fit(scene, folder)
            method.render(scene.views[0].camera)
            method.hidden(0, (36, 48))
            assert torch.get_num_threads() == 3
    finally:
        noting.remove()
    return seen


def hides_everything_and_says_so(kind, config, folder, caplog):
    """Every photograph shows something else: nothing can be learned, and at a low price all is masked."""
    scene, rng = photographed(folder, n_views=5), np.random.default_rng(0)
    for view in scene.train_views:
        write_png(view.path, rng.integers(0, 2, (36, 48, 3)).astype(np.float32))
    method = fitted(kind, config, scene, folder / "run")
    assert method.found["masked"] > 0.9
    assert f"{method.found['masked']:.1%} of the pixels masked" in method.summary().used
    assert [record.getMessage() for record in caplog.records if "masks hide" in record.getMessage()]
    assert np.isfinite(method.render(scene.test_views[0].camera)).all()


def assert_the_same_steps(folder, cuda_backend, objective_of, loss_error=1e-3, error=1e-4):
    """Four steps on both backends, with the objective that is made of the photographs, end nearly the same."""
    scene = photographed(folder, n_views=6)
    images, cameras = read_images(scene.train_views), [view.camera for view in scene.train_views]
    ends = []
    for kind in (CpuBackend, cuda_backend):
        objective = objective_of(images)
        appearance, backend = objective.appearance, kind(objective, BACKGROUND, 0.01)
        backend.put(fresh_state(with_appearance(cloud(60, 1), appearance)))
        for iteration in range(4):
            rates = {
                **rates_at(iteration, 100, LearningRates(), 4.0, 1),
                "features": appearance.feature_rate(iteration),
            }
            loss = backend.step(cameras[iteration], iteration, iteration, 1, rates, StepOptions(watch=True))
        ends.append((loss, backend.residual(cameras[4], 4, 1), appearance, backend.get(4, 0.0)))
    (loss, residual, appearance, ours), (other_loss, other_residual, other, theirs) = ends
    assert loss == pytest.approx(other_loss, rel=loss_error)
    assert residual == pytest.approx(other_residual, rel=loss_error)
    for (name, value), twin in zip(appearance.named_parameters(), other.parameters(), strict=True):
        assert (value - twin.detach().cpu()).abs().max() < 1e-4, name
    assert np.allclose(ours.gradient_sum, theirs.gradient_sum, rtol=2e-2, atol=1e-6)
    for name, value in ours.gaussians.state_dict().items():
        assert np.quantile(np.abs(value - theirs.gaussians.state_dict()[name]), 0.9) < error, name


def whole(camera):
    """All of a picture as one part [1, H, W]."""
    return np.ones((1, camera.height, camera.width), bool)


def held_out(method, scene, truth, parts=whole):
    """PSNR of the held-out views, after the best gains of each of their parts, which a cast on it leaves open."""
    scores = []
    for view in scene.test_views:
        image, expected = method.render(view.camera).copy(), truth[view.name]
        for part in parts(view.camera):
            image[part] *= (image[part] * expected[part]).sum(axis=0) / (image[part] ** 2).sum(axis=0)
        scores.append(psnr(np.clip(image, 0, 1), expected))
    return float(np.mean(scores))
