from dataclasses import replace

import numpy as np
from disturbed import disturbed, fitted
from splats import photographed
from trainings import psnr

from baselines.distractors.desplat import SHORT_LAYERS, DeSplat, DeSplatConfig
from baselines.distractors.view_layers import LayerConfig
from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import check_hidden
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy

GROWTH = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=800, sh_degree=0, strategy=GROWTH, device="cpu", resolutions=((0.2, 2),))
CONFIG = DeSplatConfig(SPLATTING, replace(SHORT_LAYERS, number=60, cover_penalty=0.02))
BRIEF = DeSplatConfig(
    replace(SPLATTING, iterations=16, checkpoint_seconds=0.0),
    LayerConfig(number=20, growth=replace(LayerConfig().growth, start=1, every=1, stop=9, budget=30, grow_grad2d=0)),
)


def floating(scene, folder, seed=0):
    """A soft bright blob before every camera, each time elsewhere."""
    height, width = scene.views[0].camera.height, scene.views[0].camera.width
    y, x = np.mgrid[:height, :width]
    places = np.random.default_rng(seed).uniform(0.25, 0.75, (len(scene.views), 2)) * (height, width)

    def behind(image, index):
        cover = 0.9 * np.exp(-(((y - places[index, 0]) ** 2 + (x - places[index, 1]) ** 2) / (2 * 7.0**2)))[..., None]
        return (1 - cover) * image + cover * np.array([1.0, 0.9, 0.1])

    return disturbed(scene, folder, behind)


def test_what_floats_before_each_camera_stays_out_of_the_scene(tmp_path):
    scene = photographed(tmp_path, n_views=16)
    shown = floating(scene, tmp_path / "floating")
    plain = fitted(GaussianSplatting, SPLATTING, shown, tmp_path / "plain")
    ours = fitted(DeSplat, CONFIG, shown, tmp_path / "desplat")
    assert psnr(ours, scene.test_views) > psnr(plain, scene.test_views) + 1
    assert "layers cover" in ours.summary().used
    size = scene.views[0].camera.height, scene.views[0].camera.width
    check_hidden(ours.hidden(0, size), size)
    assert ours.hidden(0, size).max() > 0.5
    assert plain.hidden(0, size) is None
    assert ours.summary().n_primitives == len(ours._trained.gaussians)  # of the scene alone


def test_layers_that_cover_everything_are_said(tmp_path, caplog):
    scene, hidden = photographed(tmp_path, n_views=4), []
    for opacity in (0.1, 0.95):
        layers = replace(BRIEF.layers, number=100, opacity=opacity)
        fitted(DeSplat, replace(BRIEF, layers=layers), scene, tmp_path / f"{opacity}")
        hidden.append([record for record in caplog.records if "layers hide" in record.getMessage()])
    assert [len(found) for found in hidden] == [0, 1]
