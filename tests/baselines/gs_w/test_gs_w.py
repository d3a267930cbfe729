"""GS-W as a method: what it is for, its files, resumption, and the profiles."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from looks import (
    GROWING,
    SPLATTING,
    hides_everything_and_says_so,
    threads_of_networks,
    true_pictures,
)
from splats import photographed

from baselines.gaussian_splatting import GaussianSplatting
from baselines.gs_w.config import SHORT
from baselines.gs_w.mean_appearance import average_features, coloured_for
from baselines.gs_w.method import NETWORK, GaussianInTheWild, GSWConfig
from baselines.method import check_hidden
from baselines.splatting.appearance.gaussians import gaussians_in_view
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.rasterizer import render
from baselines.training.checkpoints import read_arrays
from hydroviews.errors import InputError
from hydroviews.metrics.psnr import psnr
from hydroviews.scene.images import write_png

BRIEF = replace(SHORT, rate_maps=2e-3, rate_colour=2e-3)  # for a tenth of the iterations
CLOSE = replace(BRIEF, shrink=1, rate_maps=5e-3, visible_from=0.05)  # the small pictures are looked at as they are


def held_out(method, scene, truth, exposed=False):
    """PSNR of the held-out views; where `exposed`, after the best gain a channel and view, which a cast leaves open."""
    scores = []
    for view in scene.test_views:
        image, expected = method.render(view.camera), truth[view.name]
        gain = (image * expected).sum(axis=(0, 1)) / (image**2).sum(axis=(0, 1)) if exposed else 1
        scores.append(psnr(np.clip(image * gain, 0, 1), expected))
    return float(np.mean(scores))


def test_a_colour_cast_a_view_is_told_from_the_scene(things, things_in_casts, plain, tmp_path):
    scene, truth = things_in_casts, true_pictures(things)
    without = plain(GaussianSplatting, SPLATTING, scene)
    appearance = fitted(GaussianInTheWild, GSWConfig(SPLATTING, BRIEF), scene, tmp_path)
    assert held_out(appearance, scene, truth, exposed=True) > held_out(without, scene, truth, exposed=True) + 0.5


def test_what_comes_and_goes_is_left_out_by_the_mask(things, things_occluded, plain, tmp_path):
    scene, truth = things_occluded, true_pictures(things)
    splatting = replace(SPLATTING, iterations=200)
    unmasked = held_out(plain(GaussianSplatting, splatting, scene), scene, truth)

    def found(look, seed):
        folder = tmp_path / f"{seed}-{look.visible_from}"
        return held_out(fitted(GaussianInTheWild, GSWConfig(splatting, look), scene, folder, seed), scene, truth)

    # Two seeds: a mask that starts so early may be late in finding anything.
    masked, without = (
        np.array([found(look, seed) for seed in (0, 1)]) for look in (CLOSE, replace(CLOSE, visible_from=2.0))
    )
    assert masked.mean() > unmasked + 0.7
    assert (masked > without).all()
    assert masked.mean() > without.mean() + 0.7


def test_the_same_pixels_from_disk_and_colours_for_viewers(tmp_path):
    scene = photographed(tmp_path, n_views=6, width=37, height=29)
    config = GSWConfig(GROWING, SHORT)
    method = fitted(GaussianInTheWild, config, scene, tmp_path)
    method.save(tmp_path)
    check_hidden(method.hidden(0, (29, 37)), (29, 37))
    again = GaussianInTheWild.load(config, 0, tmp_path)
    assert again.hidden(0, (29, 37)) is None  # references are not saved
    for view in scene.views:
        assert np.array_equal(again.render(view.camera), method.render(view.camera))
    assert again.summary() == method.summary()
    assert method.summary().used == "encoder small from scratch, 0.0% of the pixels masked"
    shown = read_ply(tmp_path / SPLATS)
    assert np.array_equal(shown.sh[:, 1:], method._trained.gaussians.sh[:, 1:])
    camera = scene.train_views[0].camera
    assert psnr(np.clip(render(shown, camera)[0], 0, 1), method.render(camera)) > 25
    again.save(tmp_path / "copy")
    first, second = (read_arrays(folder / NETWORK)[0] for folder in (tmp_path, tmp_path / "copy"))
    assert all(np.array_equal(value, second[name]) for name, value in first.items())
    other = replace(config, appearance=replace(SHORT, fused=16))
    with pytest.raises(InputError, match="another network"):
        GaussianInTheWild.load(other, 0, tmp_path)


def test_networks_have_one_thread(tmp_path):
    """The last bits of what torch adds up depend on how many there are."""
    config = GSWConfig(replace(GROWING, iterations=2), SHORT)
    assert threads_of_networks(GaussianInTheWild, config, tmp_path) == {1}


def test_the_mean_appearance_is_that_of_the_views_where_they_agree(tmp_path):
    """With one reference for all adaptive maps to read, and no projection, the mean is what each view has."""
    scene = photographed(tmp_path, n_views=6)
    for view in scene.train_views:
        write_png(view.path, np.full((36, 48, 3), 0.4, np.float32))
    method = fitted(GaussianInTheWild, GSWConfig(GROWING, replace(SHORT, dropout=0.0)), scene, tmp_path)
    appearance, trained = method._objective.appearance, method._trained
    cameras = [view.camera for view in scene.train_views]
    flat = appearance.encode(0)[0].detach().mean(dim=(1, 2), keepdim=True).expand(-1, 4, 4)
    appearance.encode = lambda view: (flat, None)
    coordinates = appearance.features(trained.gaussians)
    parameters = replace(trained.gaussians, features=coordinates)
    mean = average_features(parameters, appearance, cameras, trained.near, False)
    assert np.allclose(mean.features, flat[:, 0, 0].numpy(), atol=1e-5)
    appearance._encoded = lambda view: (flat, None)
    own = gaussians_in_view(parameters, appearance, cameras[1], 1, 1)
    assert np.allclose(coloured_for(mean, method._fusion, cameras[1]).sh, own.sh, atol=1e-4)


def test_masks_that_hide_everything_are_said(tmp_path, caplog):
    cheap = replace(BRIEF, shrink=1, visible_price=0.02, visible_from=0.0, rate_maps=2e-2)
    config = GSWConfig(replace(GROWING, iterations=60), cheap)
    hides_everything_and_says_so(GaussianInTheWild, config, tmp_path, caplog)


def test_weights_of_the_encoder_come_from_a_file_that_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("HYDROVIEWS_RESNET18", raising=False)
    assert GaussianInTheWild.configuration("paper").appearance.weights is None
    path = tmp_path / "resnet18.pth"
    monkeypatch.setenv("HYDROVIEWS_RESNET18", str(path))
    with pytest.raises(InputError, match="no such file"):
        GaussianInTheWild.configuration("paper")
    path.write_bytes(b"damaged")
    config = GaussianInTheWild.configuration("paper")
    assert len(config.appearance.weights_sha256) == 64
    with pytest.raises(InputError, match="not weights of ResNet-18"):
        GaussianInTheWild(config, 0).objective(photographed(tmp_path, n_views=3), tmp_path)
    assert GaussianInTheWild.configuration("demo").appearance == SHORT
    with pytest.raises(InputError, match="no such profile"):
        GaussianInTheWild.configuration("long")


def test_the_papers_networks_take_a_step(tmp_path):
    scene = photographed(tmp_path, n_views=4)
    config = GaussianInTheWild.configuration("paper")
    config = GaussianInTheWild.with_max_iterations(config, 2)
    config = replace(
        config, appearance=replace(config.appearance, lpips=0.0), splatting=replace(config.splatting, device="cpu")
    )
    method = fitted(GaussianInTheWild, config, scene, tmp_path)
    assert np.isfinite(method.render(scene.test_views[0].camera)).all()
    assert method.summary().used.startswith("encoder resnet18 from scratch")
    assert torch.isfinite(method._objective.appearance.encode(0)[0]).all()
