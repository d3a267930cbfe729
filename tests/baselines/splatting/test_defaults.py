"""The default settings are the numbers of Kerbl et al. 2023, and what differs from their code is known."""

from dataclasses import replace

import numpy as np
import pytest
from splats import camera, cloud

from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels import constants
from baselines.splatting.kernels.adam import BETA1, BETA2, EPSILON
from baselines.splatting.schedule import LearningRates
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import SHRINK, SPLIT_INTO, DefaultStrategy
from baselines.splatting.strategies.initialisation import INITIAL_OPACITY, LARGEST, NEIGHBOURS, initialise, scene_extent
from hydroviews.scene.scenes import Points

# Of the authors' classic release: arguments/__init__.py, train.py, scene/gaussian_model.py.
PUBLISHED_TRAINING = {"iterations": 30_000, "sh_degree": 3, "sh_degree_interval": 1000, "lambda_dssim": 0.2}
PUBLISHED_RATES = {
    "means": 0.00016,
    "means_final": 0.0000016,
    "sh": 0.0025,
    "sh_rest": 0.0025 / 20,
    "opacity": 0.05,
    "scales": 0.005,
    "quaternions": 0.001,
}
PUBLISHED_GROWTH = {
    "start": 500,
    "stop": 15_000,
    "every": 100,
    "grow_grad2d": 0.0002,
    "grow_scale3d": 0.01,
    "prune_opacity": 0.005,
    "prune_scale3d": 0.1,
    "reset_every": 3000,
}


@pytest.mark.parametrize(
    ("settings", "published"),
    [(TrainerConfig, PUBLISHED_TRAINING), (LearningRates, PUBLISHED_RATES), (DefaultStrategy, PUBLISHED_GROWTH)],
)
def test_defaults_are_published(settings, published):
    assert {name: getattr(settings(), name) for name in published} == published


def test_constants_are_published():
    assert (BETA1, BETA2, EPSILON) == (0.9, 0.999, 1e-15)
    assert (INITIAL_OPACITY, NEIGHBOURS) == (0.1, 3)
    assert (2, pytest.approx(0.8 * 2)) == (SPLIT_INTO, SHRINK)
    assert (constants.LOW_PASS, constants.MAX_ALPHA, constants.MIN_ALPHA) == (0.3, 0.99, 1 / 255)
    assert pytest.approx(1e-4, rel=2e-4) == constants.MIN_TRANSMITTANCE
    assert pytest.approx(1.3) == 1 + 2 * constants.FRUSTUM_MARGIN  # of half the field of view


def test_large_gaussians_go_from_the_first_refinement_on():
    gaussians = cloud(3, 0)
    gaussians.opacity_logits[:] = 2
    gaussians.log_scales[:] = np.log([[0.05], [0.05], [0.2]])
    state = replace(fresh_state(gaussians), iteration=500)
    assert len(DefaultStrategy().refine(state, 1.0, 0).gaussians) == 2  # theirs: 3 until after 3,000 iterations


CAMERAS = [camera(40, 30, angle) for angle in np.linspace(0, 6, 12)]


def test_misplaced_cameras_do_not_stretch_the_extent():
    stray, nothing = [*CAMERAS, camera(40, 30, origin=(1000, 0, 0))], np.zeros((0, 3))
    assert scene_extent(stray, nothing)[1] == pytest.approx(scene_extent(CAMERAS, nothing)[1])


def test_a_lonely_point_starts_no_larger_than_a_share_of_the_extent():
    positions = np.random.default_rng(0).normal(0, 0.1, (120, 3))
    positions[0] = (50, 0, 0)
    gaussians = initialise(Points(positions, np.zeros((120, 3), np.uint8)), CAMERAS, 0, 0)
    assert np.exp(gaussians.log_scales.max()) == pytest.approx(LARGEST * scene_extent(CAMERAS, positions)[1], rel=1e-5)
