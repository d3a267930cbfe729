"""Wild-GS as a method: what it is for, what it survives, its files, resumption, and the profiles."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from disturbed import fitted
from looks import (
    GROWING,
    SPLATTING,
    cast,
    hides_everything_and_says_so,
    threads_of_networks,
    true_pictures,
)
from splats import cloud, photographed

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import check_hidden
from baselines.splatting.appearance.gaussians import gaussians_in_view
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.splatting.rasterizer import render
from baselines.splatting.strategies.pruning import contributions
from baselines.wild_gs.config import SHORT
from baselines.wild_gs.mean_look import mean_look
from baselines.wild_gs.method import WildGS, WildGSConfig
from baselines.wild_gs.triplane import CHANNELS
from hydroviews.errors import InputError
from hydroviews.metrics.psnr import psnr
from hydroviews.scene.images import write_png

# For a tenth of the iterations, and small pictures, which are looked at as they are.
BRIEF = replace(
    SHORT,
    shrink=1,
    side=32,
    box=1.8,
    renewed=50,
    rate_encoder=5e-3,
    rate_networks=2e-3,
    rate_intrinsic=1e-2,
    visible_from=0.05,
)
# Where light differs and nothing comes and goes: masks would take casts for that.
LIGHT = replace(BRIEF, absent=0.0, visible_from=2.0)


def held_out(method, scene, truth, parts=None):
    """PSNR of the held-out views; with `parts` after each one's best gains, which a cast on it leaves open."""
    scores = []
    for view in scene.test_views:
        image, expected = method.render(view.camera).copy(), truth[view.name]
        for part in parts(view.camera) if parts else ():
            image[part] *= (image[part] * expected[part]).sum(axis=0) / (image[part] ** 2).sum(axis=0)
        scores.append(psnr(np.clip(image, 0, 1), expected))
    return float(np.mean(scores))


def things_lit():
    """What `photographed` shows, and which of it stands under a lamp of its own."""
    things = cloud(60, degree=0, seed=3, size=0.15)
    return things, things.means[:, 0] > 0


def cast_on_a_part(scene):
    """One half of the scene's things under a lamp that shines otherwise in every photograph."""
    rng, (things, lit) = np.random.default_rng(2), things_lit()
    for view in scene.train_views:
        colours = np.maximum(0.5 + C0 * things.sh[:, 0], 0).astype(np.float32)
        colours[lit] *= np.exp(rng.normal(-0.5, 0.4, 3)).astype(np.float32)
        write_png(view.path, np.clip(render(things.coloured(colours), view.camera)[0], 0, 1))


def whole(camera):
    """All of a picture as one part [1, H, W]."""
    return np.ones((1, camera.height, camera.width), bool)


def lit_or_not(camera):
    """Where a picture shows things under the lamp, and where it does not [2, H, W]."""
    things, lit = things_lit()
    white = np.repeat(np.where(lit, np.float32(1), np.float32(0))[:, None], 3, axis=1)
    under = render(things.coloured(white), camera)[0][..., 0] > 0.5
    return np.stack([under, ~under])


@pytest.mark.parametrize(("spoilt", "parts"), [(cast, whole), (cast_on_a_part, lit_or_not)])
def test_light_that_differs_is_told_from_the_scene(tmp_path, spoilt, parts):
    scene = photographed(tmp_path)
    truth = true_pictures(scene)
    spoilt(scene)
    plain = fitted(GaussianSplatting, SPLATTING, scene, tmp_path / "plain")
    look = fitted(WildGS, WildGSConfig(SPLATTING, LIGHT), scene, tmp_path / "wild")
    assert held_out(look, scene, truth, parts) > held_out(plain, scene, truth, parts) + 0.5


def test_what_comes_and_goes_is_left_out_by_the_mask(things, things_occluded, plain, tmp_path):
    scene, truth = things_occluded, true_pictures(things)
    splatting = replace(SPLATTING, iterations=200)
    unmasked = held_out(plain(GaussianSplatting, splatting, scene), scene, truth)

    def found(look, seed):
        folder = tmp_path / f"{seed}-{look.visible_from}"
        return held_out(fitted(WildGS, WildGSConfig(splatting, look), scene, folder, seed), scene, truth)

    masked = np.mean([found(BRIEF, seed) for seed in (0, 1)])
    assert masked > unmasked + 0.5
    assert masked > found(replace(BRIEF, visible_from=2.0), 0) + 0.7


def test_the_same_pixels_from_disk_and_in_viewers(tmp_path):
    scene = photographed(tmp_path, n_views=6, width=37, height=29)
    config = WildGSConfig(GROWING, SHORT)
    method = fitted(WildGS, config, scene, tmp_path)
    method.save(tmp_path)
    check_hidden(method.hidden(0, (29, 37)), (29, 37))
    again = WildGS.load(config, 0, tmp_path)
    assert again.hidden(0, (29, 37)) is None  # references are not saved
    for view in scene.views:
        assert np.array_equal(again.render(view.camera), method.render(view.camera))
    assert again.summary() == method.summary()
    assert method.summary().used == "encoder small from scratch, 0.0% of the pixels masked"
    shown = read_ply(tmp_path / SPLATS)
    assert np.array_equal(shown.sh, method._trained.gaussians.sh)  # all of the look is in the file


def test_networks_have_one_thread(tmp_path):
    """The last bits of what torch adds up depend on how many there are."""
    config = WildGSConfig(replace(GROWING, iterations=2), replace(SHORT, local_from=0.0))
    assert threads_of_networks(WildGS, config, tmp_path) == {1}


@pytest.fixture
def alike(tmp_path):
    """A method taught with photographs of one colour, its Gaussians with their features, and its cameras."""
    scene = photographed(tmp_path, n_views=6)
    for view in scene.train_views:
        write_png(view.path, np.full((36, 48, 3), 0.4, np.float32))
    method = WildGS(WildGSConfig(GROWING, replace(BRIEF, absent=0.0)), 0)
    appearance = method.objective(scene, tmp_path).appearance
    gaussians = cloud(80, 1)
    torch.manual_seed(0)
    with torch.no_grad():
        appearance.colours.colour[-1].weight.normal_(0, 0.1)
    features = np.random.default_rng(0).normal(size=appearance.features(gaussians).shape).astype(np.float32)
    return appearance, replace(gaussians, features=features), [view.camera for view in scene.train_views]


def test_the_mean_look_is_that_of_the_views_where_they_agree(alike, monkeypatch):
    appearance, gaussians, cameras = alike

    def places(view, visible, parameters, camera):
        """What lies where, whoever looks."""
        return parameters["means"].detach().repeat(1, 6)[:, :CHANNELS]

    monkeypatch.setattr(appearance, "read", places)
    mean = mean_look(gaussians, appearance, cameras, 0.1, False)
    appearance._steps = appearance.iterations
    own = gaussians_in_view(gaussians, appearance, cameras[1], 1, 1)
    rows = [int(np.flatnonzero((mean.means == position).all(axis=1))[0]) for position in own.means]
    assert np.allclose(mean.sh[rows], own.sh, atol=1e-5)
    assert np.abs(mean.sh - gaussians.sh).max() > 0.05
    assert mean.features is None


def test_the_mean_is_taken_before_the_networks_of_codes_and_by_pixels(alike, monkeypatch):
    appearance, gaussians, cameras = alike
    codes = []
    monkeypatch.setattr(
        appearance, "read", lambda view, _, seen, __: torch.full((len(seen["means"]), CHANNELS), float(view))
    )
    monkeypatch.setattr(appearance, "encode", lambda view: (torch.full((64,), float(view)), torch.ones(4, 4)))
    understood = appearance.colours.codes
    monkeypatch.setattr(appearance.colours, "codes", lambda *given: codes.append(given) or understood(*given))
    mean_look(gaussians, appearance, cameras, 0.1, False)
    whole, places, _ = codes[0]
    pixels = np.stack([contributions(gaussians.bare(), [camera], 0.1, False) for camera in cameras])
    expected = (np.arange(len(cameras))[:, None] * pixels).sum(axis=0) / pixels.sum(axis=0).clip(1e-9)
    seen = pixels.sum(axis=0) > 1
    assert seen.sum() > 40
    assert torch.allclose(whole, torch.full((64,), np.arange(len(cameras)).mean()))
    assert np.allclose(places[:, 0].numpy()[seen], expected[seen], atol=1e-3)


def test_one_view_and_a_scene_that_it_does_not_show(tmp_path):
    scene = photographed(tmp_path, n_views=3)
    scene = replace(scene, split=replace(scene.split, train=scene.split.train[:1]))
    nothing = replace(scene, points=replace(scene.points, positions=scene.points.positions + 1e3))
    method = fitted(WildGS, WildGSConfig(GROWING, BRIEF), nothing, tmp_path / "far")
    assert not method.render(scene.test_views[0].camera).any()


def test_masks_that_hide_everything_are_said(tmp_path, caplog):
    cheap = replace(BRIEF, price_first=0.02, price_last=0.02, visible_from=0.0, rate_encoder=2e-2)
    hides_everything_and_says_so(WildGS, WildGSConfig(replace(GROWING, iterations=60), cheap), tmp_path, caplog)


def test_weights_of_the_encoder_come_from_a_file_that_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("HYDROVIEWS_RESNET18", raising=False)
    assert WildGS.configuration("paper").look.weights is None
    path = tmp_path / "resnet18.pth"
    monkeypatch.setenv("HYDROVIEWS_RESNET18", str(path))
    with pytest.raises(InputError, match="no such file"):
        WildGS.configuration("paper")
    path.write_bytes(b"damaged")
    config = WildGS.configuration("paper")
    assert len(config.look.weights_sha256) == 64
    with pytest.raises(InputError, match="not weights of ResNet-18"):
        WildGS(config, 0).objective(photographed(tmp_path, n_views=3), tmp_path)
    assert WildGS.configuration("demo").look == SHORT
    with pytest.raises(InputError, match="no such profile"):
        WildGS.configuration("long")


def test_the_papers_networks_take_a_step(tmp_path, monkeypatch):
    monkeypatch.delenv("HYDROVIEWS_RESNET18", raising=False)
    scene = photographed(tmp_path, n_views=4)
    config = WildGS.with_max_iterations(WildGS.configuration("paper"), 2)
    config = replace(config, splatting=replace(config.splatting, device="cpu"))
    method = fitted(WildGS, config, scene, tmp_path)
    assert np.isfinite(method.render(scene.test_views[0].camera)).all()
    assert method.summary().used.startswith("encoder resnet18 from scratch")
