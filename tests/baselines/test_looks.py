"""Methods of Gaussians whose colours are made of photographs: what GS-W and Wild-GS have in common."""

from dataclasses import replace

import numpy as np
import pytest
from disturbed import fitted
from looks import (
    BRIEF,
    GROWING,
    LIGHT,
    SPLATTING,
    assert_the_same_steps,
    held_out,
    hides_everything_and_says_so,
    threads_of_networks,
    true_pictures,
)
from splats import photographed

from baselines.encoders.objective import PerceptualObjective
from baselines.gaussian_splatting import GaussianSplatting
from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT as REFERENCE
from baselines.gs_w.method import GaussianInTheWild, GSWConfig
from baselines.method import check_hidden
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.rasterizer import render
from baselines.wild_gs.appearance import LookAppearance
from baselines.wild_gs.config import SHORT as LOOK
from baselines.wild_gs.method import WildGS, WildGSConfig
from hydroviews.errors import InputError
from hydroviews.metrics.psnr import psnr

# For a tenth of the iterations, and small pictures, which are looked at as they are.
CLOSE = replace(REFERENCE, shrink=1, rate_maps=5e-3, rate_colour=2e-3, visible_from=0.05)
METHODS = [
    pytest.param(GaussianInTheWild, GSWConfig, CLOSE, id="gs-w"),
    pytest.param(WildGS, WildGSConfig, BRIEF, id="wild-gs"),
]


@pytest.mark.parametrize(("kind", "config", "look"), METHODS)
def test_what_comes_and_goes_is_left_out_by_the_mask(things, things_occluded, plain, tmp_path, kind, config, look):
    scene, truth = things_occluded, true_pictures(things)
    splatting = replace(SPLATTING, iterations=200)

    def quality(method):
        return np.mean([psnr(method.render(view.camera), truth[view.name]) for view in scene.test_views])

    def found(look, seed=0):
        return quality(fitted(kind, config(splatting, look), scene, tmp_path / f"{seed}-{look.visible_from}", seed))

    # Two seeds: a mask that starts so early may be late in finding anything.
    masked = np.mean([found(look, seed) for seed in (0, 1)])
    assert masked > quality(plain(GaussianSplatting, splatting, scene)) + 0.5
    assert masked > found(replace(look, visible_from=2.0)) + 0.7


@pytest.mark.parametrize(
    ("kind", "config"),
    [
        (GaussianInTheWild, GSWConfig(SPLATTING, replace(REFERENCE, rate_maps=2e-3, rate_colour=2e-3))),
        (WildGS, WildGSConfig(SPLATTING, LIGHT)),
    ],
    ids=["gs-w", "wild-gs"],
)
def test_a_colour_cast_a_view_is_told_from_the_scene(things, things_in_casts, plain, tmp_path, kind, config):
    scene, truth = things_in_casts, true_pictures(things)
    ours, without = fitted(kind, config, scene, tmp_path), plain(GaussianSplatting, SPLATTING, scene)
    assert held_out(ours, scene, truth) > held_out(without, scene, truth) + 0.5


@pytest.mark.parametrize(
    ("kind", "config", "least"),
    [(GaussianInTheWild, GSWConfig(GROWING, REFERENCE), 25), (WildGS, WildGSConfig(GROWING, LOOK), 150)],
    ids=["gs-w", "wild-gs"],
)
def test_viewers_see_the_mean_look_and_references_are_not_saved(tmp_path, kind, config, least):
    scene = photographed(tmp_path, n_views=6, width=37, height=29)
    method = fitted(kind, config, scene, tmp_path)
    method.save(tmp_path)
    check_hidden(method.hidden(0, (29, 37)), (29, 37))
    assert kind.load(config, 0, tmp_path).hidden(0, (29, 37)) is None
    camera, shown = scene.test_views[0].camera, read_ply(tmp_path / SPLATS)
    image = np.clip(render(shown, camera, near=method._trained.near)[0], 0, 1)
    assert psnr(image, method.render(camera)) > least


@pytest.mark.parametrize(("kind", "config", "look"), METHODS)
def test_networks_have_one_thread(tmp_path, kind, config, look):
    """The last bits of what torch adds up depend on how many there are."""
    assert threads_of_networks(kind, config(replace(GROWING, iterations=2), look), tmp_path) == {1}


@pytest.mark.parametrize(
    ("kind", "config", "cheap"),
    [
        (GaussianInTheWild, GSWConfig, replace(CLOSE, visible_price=0.02, visible_from=0.0, rate_maps=2e-2)),
        (WildGS, WildGSConfig, replace(BRIEF, price_first=0.02, price_last=0.02, visible_from=0.0, rate_encoder=2e-2)),
    ],
    ids=["gs-w", "wild-gs"],
)
def test_masks_that_hide_everything_are_said(tmp_path, caplog, kind, config, cheap):
    hides_everything_and_says_so(kind, config(replace(GROWING, iterations=60), cheap), tmp_path, caplog)


def reference(images):
    return ReferenceAppearance(images, replace(REFERENCE, visible_from=0.02), 1, 100, 0)


def look(images):
    seeing = replace(LOOK, visible_from=0.02, local_from=0.01, absent=0.0, side=16, box=1.8)
    return LookAppearance(images, seeing, 1, 100, 0, 0.01)


@pytest.mark.parametrize("appearance", [reference, look])
def test_the_gpu_takes_the_same_steps(tmp_path, cuda_backend, appearance):
    """On the CPU's kernels and on gsplat's, whose kernels are replayed."""
    assert_the_same_steps(tmp_path, cuda_backend, lambda images: PerceptualObjective(images, 0.2, appearance(images)))


@pytest.mark.parametrize(("kind", "part"), [(GaussianInTheWild, "appearance"), (WildGS, "look")])
def test_weights_of_the_encoder_come_from_a_file_that_is_named(tmp_path, monkeypatch, kind, part):
    monkeypatch.delenv("HYDROVIEWS_RESNET18", raising=False)
    assert getattr(kind.configuration("paper"), part).weights is None
    path = tmp_path / "resnet18.pth"
    monkeypatch.setenv("HYDROVIEWS_RESNET18", str(path))
    with pytest.raises(InputError, match="no such file"):
        kind.configuration("paper")
    path.write_bytes(b"damaged")
    config = kind.configuration("paper")
    assert len(getattr(config, part).weights_sha256) == 64
    with pytest.raises(InputError, match="not weights of ResNet-18"):
        kind(config, 0).objective(photographed(tmp_path, n_views=3), tmp_path)


@pytest.mark.parametrize("kind", [GaussianInTheWild, WildGS])
def test_the_papers_networks_take_a_step(tmp_path, monkeypatch, kind):
    monkeypatch.delenv("HYDROVIEWS_RESNET18", raising=False)
    scene = photographed(tmp_path, n_views=4)
    config = kind.with_max_iterations(kind.configuration("paper"), 2)
    config = replace(config, splatting=replace(config.splatting, device="cpu"))
    if kind is GaussianInTheWild:
        config = replace(config, appearance=replace(config.appearance, lpips=0.0))
    method = fitted(kind, config, scene, tmp_path)
    assert np.isfinite(method.render(scene.test_views[0].camera)).all()
    assert method.summary().used.startswith("encoder resnet18 from scratch")
