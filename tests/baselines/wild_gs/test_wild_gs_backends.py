"""The same steps on the CPU's kernels and on gsplat's, whose kernels are replayed."""

from dataclasses import replace

import numpy as np
import pytest
from splats import BACKGROUND, cloud, photographed

from baselines.gs_w.objective import VisibleObjective
from baselines.splatting.appearance.gaussians import with_appearance
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import StepOptions
from baselines.training.images import read_images
from baselines.wild_gs.appearance import LookAppearance
from baselines.wild_gs.config import SHORT


def test_the_gpu_takes_the_same_steps(tmp_path, cuda_backend):
    scene = photographed(tmp_path, n_views=6)
    images, cameras = read_images(scene.train_views), [view.camera for view in scene.train_views]
    look = replace(SHORT, visible_from=0.02, local_from=0.01, absent=0.0, side=16, box=1.8)
    ends = []
    for kind in (CpuBackend, cuda_backend):
        appearance = LookAppearance(images, look, 1, 100, 0, 0.01)
        backend = kind(VisibleObjective(images, 0.2, appearance), BACKGROUND, 0.01)
        backend.put(fresh_state(with_appearance(cloud(60, 1), appearance)))
        for iteration in range(4):
            rates = {
                **rates_at(iteration, 100, LearningRates(), 4.0, 1),
                "features": appearance.feature_rate(iteration),
            }
            loss = backend.step(cameras[iteration], iteration, iteration, 1, rates, StepOptions(watch=True))
        ends.append((loss, backend.residual(cameras[4], 4, 1), appearance, backend.get(4, 0.0).gaussians))
    (loss, residual, appearance, ours), (other_loss, other_residual, other, theirs) = ends
    assert loss == pytest.approx(other_loss, rel=1e-3)
    assert residual == pytest.approx(other_residual, rel=1e-3)
    for (name, value), twin in zip(appearance.named_parameters(), other.parameters(), strict=True):
        assert (value - twin.detach().cpu()).abs().quantile(0.9) < 1e-4, name
    for name, value in ours.state_dict().items():
        assert np.quantile(np.abs(value - theirs.state_dict()[name]), 0.9) < 1e-4, name
