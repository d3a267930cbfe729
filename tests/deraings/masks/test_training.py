"""Masks within a training: they take part in the loss, and a crash leaves no trace."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import capture_in

from baselines.splatting.config import TrainerConfig
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import photometric_loss
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.trainer import train
from baselines.training.images import read_images
from deraings.masks.config import MaskConfig
from deraings.masks.occlusion_masks import OcclusionMasks
from hydroviews.errors import InputError

CONFIG = TrainerConfig(iterations=24, sh_degree=1, strategy=DefaultStrategy(start=99), device="cpu")
MASKS = MaskConfig(start=0.4, warm_up=0.2, every=2, width=8, rate=0.02, min_evidence=0)


class Masked(Objective):
    """The photographs compared under masks; raises at one iteration, as a power cut would."""

    def __init__(self, images, masks=MASKS, fails_at=None):
        super().__init__(images)
        self.masks = OcclusionMasks(images, CONFIG.iterations, 0, masks)
        self._fails_at = fails_at

    def __call__(self, image, view, iteration, buffers):
        if iteration == self._fails_at:
            raise RuntimeError("power cut")
        size = image.shape[0], image.shape[1]
        target = self.target(view, size)
        if self.masks.due(iteration):
            self.masks.learn(view, loss_map(image, target, buffers=buffers), iteration)
        return photometric_loss(image, target, weights=self.masks.weights(view, size, iteration), buffers=buffers)

    def settings(self):
        return {"masks": self.masks.settings()}

    def state_dict(self):
        return self.masks.state_dict()

    def load_state_dict(self, arrays):
        self.masks.load_state_dict(arrays)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return capture_in(tmp_path_factory.mktemp("capture"))


def bits(trained, objective):
    arrays = objective.state_dict()
    return [getattr(trained.gaussians, name).tobytes() for name in FIELDS], {n: arrays[n].tobytes() for n in arrays}


def test_a_crash_leaves_no_trace_in_scene_or_masks(scene, tmp_path):
    images = read_images(scene.train_views)
    whole = Masked(images)
    expected = bits(train(scene, CONFIG, 0, tmp_path / "whole", whole), whole)
    unmasked = train(scene, CONFIG, 0, tmp_path / "unmasked", Objective(images))
    assert expected[0] != [getattr(unmasked.gaussians, name).tobytes() for name in FIELDS]
    config = replace(CONFIG, checkpoint_seconds=0.0)
    for iteration in (7, 17):
        with pytest.raises(RuntimeError, match="power cut"):
            train(scene, config, 0, tmp_path / "crashed", Masked(images, fails_at=iteration))
    again = Masked(images)
    assert bits(train(scene, config, 0, tmp_path / "crashed", again), again) == expected
    assert np.ptp(np.concatenate([again.masks.mask(view, (36, 48)).ravel() for view in range(7)])) > 0.05


def test_a_checkpoint_of_other_masks_is_refused(scene, tmp_path):
    images = read_images(scene.train_views)
    train(scene, replace(CONFIG, iterations=3), 0, tmp_path, Masked(images))
    with pytest.raises(InputError, match="objective"):
        train(scene, replace(CONFIG, iterations=3), 0, tmp_path, Masked(images, replace(MASKS, penalty=0.5)))
