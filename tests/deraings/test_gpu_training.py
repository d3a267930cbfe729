"""Every method of Gaussians on a pretended GPU: tensors are where they should be, and a step asks for no more.

Half-way the machine is lost; another card goes on. On a real GPU, where there is one, nobody counts what is asked.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from splats import photographed

from baselines.distractors.desplat import DeSplat, DeSplatConfig
from baselines.distractors.robust_filter import RobustFilter, RobustFilterConfig
from baselines.distractors.spotless import Spotless, SpotlessConfig
from baselines.distractors.view_layers import LayerConfig
from baselines.gaussian_splatting import BudgetedSplatting, GaussianSplatting
from baselines.gs_w.config import SHORT
from baselines.gs_w.method import GaussianInTheWild, GSWConfig
from baselines.masking.feature_network import MaskNetworkConfig
from baselines.masking.uncertainty import UncertaintyConfig
from baselines.nimbus.config import MediumConfig, NimbusConfig, ResidualConfig
from baselines.nimbus.method import Nimbus
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.config import EarlyStop, Pruning, TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.devices import missing_for_cuda
from baselines.wild_gaussians.appearance import AppearanceConfig
from baselines.wild_gaussians.method import WildConfig, WildGaussians
from baselines.wild_gs.config import SHORT as LOOK
from baselines.wild_gs.method import WildGS, WildGSConfig
from deraings.masks.config import MaskConfig
from deraings.method import DeRainGS, DeRainGSConfig
from deraings.rain_model.config import RainConfig
from deraings.spotless_lens import SpotlessLens
from hydroviews.errors import InputError

STEPS, LOST = 14, 7  # in all; done when the machine is lost
GROWTH = DefaultStrategy(start=3, stop=11, every=4, budget=150, reset_every=8, grow_grad2d=1e-7, prune_scale3d=1.0)
HURRIED = TrainerConfig(iterations=STEPS, sh_degree=1, sh_degree_interval=4, strategy=GROWTH, checkpoint_seconds=0.0)
RELOCATING = MCMCStrategy(start=3, stop=11, every=4, budget=150, growth=0.1, noise=5e4)
PRUNING = replace(
    HURRIED, pruning=Pruning(at=(0.5,), budget=60), early_stop=EarlyStop(every=4, patience=9), antialiased=True
)
MASKS = MaskConfig(start=0.3, every=2, min_evidence=0)
TONES = WildConfig(
    HURRIED,
    AppearanceConfig(width=16, scale=0.3),
    UncertaintyConfig("alexnet", start=6, warm_up=2, protected=0, rate=1e-2, every=2),
    sky=50,
)
HAZY = NimbusConfig(HURRIED, MediumConfig(cells=8, first=0.1, renewed=3, least=0), ResidualConfig(first=0.3, every=0.2))
TAUGHT = SpotlessConfig(HURRIED, network=MaskNetworkConfig("vgg", octaves=4))
METHODS = {  # and the most uploads, downloads and questions of a step, which sees its picture for the first time
    "3dgs": (GaussianSplatting, HURRIED, (7, 1, 0)),
    "relocating": (BudgetedSplatting, replace(HURRIED, strategy=RELOCATING), (7, 1, 0)),
    "pruning": (BudgetedSplatting, PRUNING, (7, 1, 0)),
    "masks": (DeRainGS, DeRainGSConfig(HURRIED, masks=MASKS), (9, 3, 0)),
    "robust": (RobustFilter, RobustFilterConfig(HURRIED), (8, 2, 0)),
    "spotless": (Spotless, TAUGHT, (12, 3, 0)),
    "spotless-lens": (SpotlessLens, TAUGHT, (13, 3, 0)),
    "desplat": (DeSplat, DeSplatConfig(HURRIED, LayerConfig(number=20)), (8, 2, 0)),
    "rain": (DeRainGS, DeRainGSConfig(HURRIED, rain=RainConfig()), (15, 4, 0)),  # mist and drops, and their gradients
    "wild": (WildGaussians, TONES, (16, 4, 2)),
    "gs-w": (GaussianInTheWild, GSWConfig(HURRIED, SHORT), (17, 3, 2)),
    "wild-gs": (WildGS, WildGSConfig(HURRIED, LOOK), (18, 7, 2)),
    "nimbus": (Nimbus, HAZY, (21, 8, 1)),
}


@pytest.fixture(params=["pretended", "real"])
def asked(request, monkeypatch):
    """What each step asks of the GPU, None if nobody counts; the step after LOST ends the program."""
    if request.param == "pretended":
        counts = request.getfixturevalue("pretended_gpu").counts
    elif lacking := missing_for_cuda(GSPLAT):
        pytest.skip(f"needs an NVIDIA GPU and gsplat: {lacking}")
    else:
        counts = None
    from baselines.splatting.backends.cuda import CudaBackend

    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda")
    step, seen = CudaBackend.step, []

    def watched(*given):
        before = Counter(counts)
        if len(seen) == LOST:
            seen.append(None)
            raise KeyboardInterrupt
        loss = step(*given)
        seen.append(None if counts is None else counts - before)
        return loss

    monkeypatch.setattr(CudaBackend, "step", watched)
    return seen


@pytest.mark.parametrize("name", METHODS)
def test_a_method_trains_goes_on_on_another_card_and_comes_back(asked, tmp_path, monkeypatch, name):
    kind, config, most = METHODS[name]
    scene, folder = photographed(tmp_path / "scene", 5, 40, 32), tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        kind(config, 0).fit(scene, folder)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda *_: "another card")
    method = kind(config, 0)
    method.fit(scene, folder)
    assert len(asked) == STEPS + 1
    counted = [counts for counts in asked if counts is not None]
    if counted:
        assert tuple(max(counts[what] for counts in counted) for what in ("uploads", "downloads", "questions")) == most

    summary = method.summary()
    assert (summary.device, summary.render_device) == ("another card", "cpu")
    method.save(folder)
    picture = method.render(scene.test_views[0].camera)
    assert np.isfinite(picture).all()
    assert np.array_equal(kind.load(config, 0, folder).render(scene.test_views[0].camera), picture)


def test_the_cpu_does_not_go_on_from_a_gpu(asked, tmp_path, monkeypatch):
    scene = photographed(tmp_path / "scene", 5, 40, 32)
    with pytest.raises(KeyboardInterrupt):
        GaussianSplatting(HURRIED, 0).fit(scene, tmp_path / "run")
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cpu")
    with pytest.raises(InputError, match=r"device[\s\S]*cuda"):
        GaussianSplatting(HURRIED, 0).fit(scene, tmp_path / "run")
