"""Short trainings, disturbed in one way or another, that the tests compare."""

from dataclasses import replace

import numpy as np
import pytest

from baselines.splatting.gaussians import FIELDS
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.splatting.trainer import TrainerConfig, train
from baselines.training.images import read_images

DENSIFY = DefaultStrategy(start=20, stop=150, every=20, budget=150, reset_every=60, grow_grad2d=5e-5, prune_scale3d=1.0)
CONFIG = TrainerConfig(iterations=200, sh_degree=1, sh_degree_interval=60, strategy=DENSIFY, device="cpu")
RELOCATION = MCMCStrategy(start=20, stop=150, every=20, budget=150, growth=0.1, noise=5e4)
BUDGETED = replace(CONFIG, strategy=RELOCATION)
# Plain splatting, for comparison with methods that leave out a part of what photographs show.
UNSPARING = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
PLAIN = TrainerConfig(iterations=400, sh_degree=0, strategy=UNSPARING, device="cpu")


class Interrupted(Objective):
    """Does something at one iteration."""

    def __init__(self, images, iteration, action):
        super().__init__(images)
        self._when, self._action = iteration, action

    def settings(self):
        return {"name": "Objective", "lambda_dssim": 0.2}

    def __call__(self, image, view, iteration, buffers):
        if iteration == self._when:
            self._action()
        return super().__call__(image, view, iteration, buffers)


def crashed_and_resumed(scene, config, iteration, folder):
    """What a training becomes that breaks off in a step and is then resumed, to save at the end alone."""

    def crash():
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        train(scene, config, 0, folder, Interrupted(read_images(scene.train_views), iteration, crash))
    return train(scene, replace(config, checkpoint_seconds=1e9), 0, folder)


def assert_identical(one, two):
    for name in FIELDS:
        assert getattr(one.gaussians, name).tobytes() == getattr(two.gaussians, name).tobytes(), name


def psnr(method, views):
    errors = [((method.render(view.camera) - view.image()) ** 2).mean() for view in views]
    return float(np.mean(-10 * np.log10(errors)))
