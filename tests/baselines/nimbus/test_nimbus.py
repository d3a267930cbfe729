"""NimbusGS on small made-up scenes. Thresholds of what it has to gain were written down before the first run."""

from dataclasses import replace

import numpy as np
import pytest
from disturbed import disturbed, fitted, only_in_training, whole_and_resumed
from splats import cloud, photographed
from trainings import PLAIN, psnr

import baselines.nimbus.method as nimbus
from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import check_hidden
from baselines.nimbus.config import MediumConfig, NimbusConfig, ResidualConfig
from baselines.nimbus.method import Nimbus
from baselines.nimbus.objective import NimbusObjective
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.rasterizer import depth, render
from baselines.training.images import TrainingImages

SPLATTING = replace(PLAIN, iterations=500, resolutions=((0.2, 2),))
MEDIUM = MediumConfig(cells=12, rate=0.02, renewed=100, dark=0.05, ray_shrink=2)
BRIEF = NimbusConfig(
    replace(SPLATTING, iterations=16, checkpoint_seconds=0.0),
    replace(MEDIUM, first=0.2, renewed=3, least=0.0),
    ResidualConfig(first=0.4, every=0.2),
)
EXTINCTION, AIR, SKY = 0.15, np.array([0.75, 0.8, 0.85]), 6.0  # per world unit; SKY: how far the haze reaches


def in_haze(scene, folder):
    """Haze by the distance of what `photographed` shows, in the training views."""
    truth = cloud(60, degree=0, seed=3, size=0.15)

    def behind(image, index):
        camera = scene.views[index].camera
        _, state = render(truth, camera)
        across, down = camera.slopes
        longer = np.sqrt(1 + across[None] ** 2 + down[:, None] ** 2)
        distance = np.where(state.transmittance < 0.5, depth(state) * longer, SKY)
        share = np.exp(-EXTINCTION * distance)[..., None]
        return share * image + (1 - share) * AIR

    return disturbed(scene, folder, only_in_training(scene, behind))


def in_specks(scene, folder):
    """Bright specks of 3 x 3 pixels, elsewhere in each training view: a fifth of it."""
    rng = np.random.default_rng(0)

    def before(image, index):
        height, width = image.shape[:2]
        for top, left in zip(*(rng.integers(0, side - 2, 42) for side in (height, width)), strict=True):
            image[top : top + 3, left : left + 3] = 0.95
        return image

    return disturbed(scene, folder, only_in_training(scene, before))


def compared(ours, shown, scene, folder):
    """NimbusGS of a configuration, trained on what is shown, and by how much it beats plain 3DGS."""
    plain = fitted(GaussianSplatting, SPLATTING, shown, folder / "plain")
    method = fitted(Nimbus, ours, shown, folder / "nimbus")
    return method, psnr(method, scene.test_views) - psnr(plain, scene.test_views)


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    return photographed(tmp_path_factory.mktemp("many"), n_views=16)


def test_haze_stays_out_of_the_scene(many, tmp_path):
    ours, gain = compared(NimbusConfig(SPLATTING, MEDIUM, None), in_haze(many, tmp_path), many, tmp_path)
    assert gain > 1
    assert "medium takes" in ours.summary().used
    hidden = ours.hidden(0, (36, 48))
    check_hidden(hidden, (36, 48))
    assert 0.1 < hidden.mean() < 0.9


def test_clear_air_has_no_medium(many, tmp_path):
    ours, gain = compared(NimbusConfig(SPLATTING, MEDIUM, None), many, many, tmp_path)
    assert gain > -1
    assert "medium none" in ours.summary().used
    assert ours._objective.given_up
    assert (ours._objective.transmission(0, (9, 12)) == 1).all()


def test_specks_stay_out_of_the_scene(many, tmp_path):
    shown = in_specks(many, tmp_path)
    ours, gain = compared(NimbusConfig(SPLATTING, None), shown, many, tmp_path)
    assert gain > 0.5
    speck, found = shown.train_views[0].image().min(axis=2) > 0.9, ours.hidden(0, (36, 48))
    check_hidden(found, (36, 48))
    assert found[speck].mean() > found[~speck].mean() + 0.5


def test_gradients_are_those_of_the_loss(tmp_path):
    """By the scene, through the medium, against differences: of parts of the picture, in the gradient's own direction.

    Along others what is left of a slope is no more than the kinks of L1 that a step meets.
    """
    scene, rng, step = photographed(tmp_path, n_views=3), np.random.default_rng(0), 1e-3
    config = NimbusConfig(SPLATTING, replace(MEDIUM, dark=0.5, variation=0.0), None)
    start = rng.random((36, 48, 3)).astype(np.float32)

    def loss_at(image):
        objective = Nimbus(config, 0).objective(scene, tmp_path)
        objective.medium.log_scale.data.fill_(1.0)
        objective._depths[0] = 450, np.full((18, 24), 4, np.float32)
        return objective(image.astype(np.float32), 0, 450, BufferPool())

    gradient = loss_at(start)[1].astype(np.float64)
    for _ in range(4):
        way = np.sign(gradient) * (rng.random(start.shape) < 0.3)
        slope = (loss_at(start + step * way)[0] - loss_at(start - step * way)[0]) / (2 * step)
        assert slope == pytest.approx((gradient * way).sum(), rel=0.03)


@pytest.mark.parametrize("judged", [0.3, 0.8])
def test_a_medium_that_was_given_up_stays_so_when_a_run_goes_on(tmp_path, judged):
    """Before the interruption, and after it."""
    config = replace(BRIEF, medium=replace(BRIEF.medium, judged=judged, least=0.9))
    for method in whole_and_resumed(
        Nimbus, config, photographed(tmp_path, n_views=4), tmp_path, nimbus, "NimbusObjective"
    ):
        assert method._objective.given_up
        assert "medium none" in method.summary().used


def test_pixels_of_the_residual_pull_at_nothing():
    """Not even through the windows of SSIM that they share with others."""
    photograph = np.random.default_rng(0).uniform(0, 0.5, (36, 48, 3)).astype(np.float32)
    image = photograph + np.float32(0.02)
    image[10:14, 10:14], photograph[10:14, 10:14] = 0, 0.9
    objective = NimbusObjective(TrainingImages([(255 * photograph).astype(np.uint8)]), [None], BRIEF, None, 0.01)
    _, gradient = objective(image, 0, 10, BufferPool())
    chosen = objective.residuals.chosen[0]
    assert chosen[10:14, 10:14].all()
    assert not gradient[chosen].any()
    assert gradient[~chosen].any()
