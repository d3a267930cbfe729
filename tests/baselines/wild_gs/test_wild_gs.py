"""Wild-GS: what it is for, its files, and what a view's colours are made of, when, and what may not be in them."""

from dataclasses import replace

import numpy as np
import torch
from disturbed import fitted
from looks import BRIEF, GROWING, LIGHT, SPLATTING, all_grey, held_out, true_pictures
from splats import camera, cloud, photographed

from baselines.encoders.objective import PerceptualObjective
from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.appearance.gaussians import AppearanceGaussians, gaussians_in_view, with_appearance
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.splatting.rasterizer import render
from baselines.training.images import TrainingImages
from baselines.wild_gs.appearance import LookAppearance
from baselines.wild_gs.colours import REST
from baselines.wild_gs.config import SHORT
from baselines.wild_gs.mean_look import mean_look
from baselines.wild_gs.method import WildGS, WildGSConfig
from baselines.wild_gs.triplane import CHANNELS
from hydroviews.scene.images import write_png


def test_a_lamp_on_a_part_of_the_scene_is_told_from_the_scene(tmp_path):
    """One half of the things stands under a lamp that shines otherwise in every photograph."""
    scene, things, rng = photographed(tmp_path), cloud(60, degree=0, seed=3, size=0.15), np.random.default_rng(2)
    truth, lit = true_pictures(scene), things.means[:, 0] > 0
    for view in scene.train_views:
        colours = np.maximum(0.5 + C0 * things.sh[:, 0], 0).astype(np.float32)
        colours[lit] *= np.exp(rng.normal(-0.5, 0.4, 3)).astype(np.float32)
        write_png(view.path, np.clip(render(things.coloured(colours), view.camera)[0], 0, 1))

    def lit_or_not(camera):
        """The places of a picture that show things under the lamp, and all others [2, H, W]."""
        white = np.repeat(lit[:, None], 3, axis=1).astype(np.float32)
        under = render(things.coloured(white), camera)[0][..., 0] > 0.5
        return np.stack([under, ~under])

    plain = fitted(GaussianSplatting, SPLATTING, scene, tmp_path / "plain")
    look = fitted(WildGS, WildGSConfig(SPLATTING, LIGHT), scene, tmp_path / "wild")
    assert held_out(look, scene, truth, lit_or_not) > held_out(plain, scene, truth, lit_or_not) + 0.5


def test_the_mean_look_is_that_of_the_views_where_they_agree(tmp_path, monkeypatch):
    scene = all_grey(photographed(tmp_path, n_views=6))
    method = WildGS(WildGSConfig(GROWING, replace(BRIEF, absent=0.0)), 0)
    appearance, gaussians = restless(method.objective(scene, tmp_path).appearance), cloud(80, 1)
    features = np.random.default_rng(0).normal(size=appearance.features(gaussians).shape).astype(np.float32)
    gaussians, cameras = replace(gaussians, features=features), [view.camera for view in scene.train_views]

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


HEIGHT, WIDTH = 30, 41
SEEING = replace(SHORT, absent=0.0, local_from=0.0, side=16, lifted=41, shrink=1, box=1.8)  # all of it in every step
VIEW = camera(WIDTH, HEIGHT)


def appearance_of(config=SEEING, pixels=None, iterations=10, ignored=()):
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 255, (2, HEIGHT, WIDTH, 3)).astype(np.uint8) if pixels is None else pixels
    return LookAppearance(TrainingImages(list(pixels), ignored), config, 1, iterations, 0, 0.1)


def restless(appearance):
    """The same with a last layer that says something."""
    torch.manual_seed(1)
    with torch.no_grad():
        appearance.colours.colour[-1].weight.normal_(0, 0.1)
    return appearance


def opaque(appearance):
    """Gaussians that cover the view."""
    gaussians = replace(cloud(200, 1, size=0.25), opacity_logits=np.full(200, 3, np.float32))
    return with_appearance(gaussians, appearance)


def test_colours_are_what_the_layers_say_of_codes_and_intrinsic_numbers():
    colours = restless(appearance_of()).colours
    codes, intrinsic = torch.rand(7, 2 * SEEING.code), torch.rand(7, SEEING.intrinsic)
    found = colours.added(codes, intrinsic)
    said = colours.colour(torch.cat([codes, intrinsic], dim=1)).reshape(7, 4, 3)
    assert torch.allclose(found[:, 0], said[:, 0] / C0)
    assert torch.allclose(found[:, 1:], REST * said[:, 1:] / C0)


def test_what_lies_beyond_the_box_shares_one_local_code():
    colours = appearance_of().colours
    colours.enclose(cloud(500).means)
    with torch.no_grad():
        colours.outside.normal_()
    positions = torch.tensor([[0, 0, 0], [0.9, -0.9, 0.5], [1.1, 0, 0], [0, -7, 0]])
    whole, places = torch.rand(colours.of_whole[0].in_features), torch.rand(4, CHANNELS)
    codes = colours.codes(whole, places, positions)
    local = codes[:, SEEING.code :]
    assert torch.allclose(local[:2], colours.of_place(places[:2]))
    assert torch.equal(local[2:], colours.outside.expand(2, -1))
    assert torch.equal(codes[:, : SEEING.code], colours.of_whole(whole).expand(4, -1))
    assert torch.equal(colours.codes(whole, None, positions)[:, SEEING.code :], colours.outside.expand(4, -1))


def test_gradients_reach_the_gaussians_colours_and_numbers_every_network_and_no_position():
    appearance = restless(appearance_of())
    found = AppearanceGaussians(opaque(appearance), appearance, VIEW, 0, 1)
    upstream = cloud(200, 1, seed=5).select(found.rows)
    gradients = found.backward(upstream, upstream.sh[None], BufferPool())
    assert np.array_equal(gradients.means[found.rows], upstream.means)
    assert np.array_equal(gradients.sh[found.rows], upstream.sh)
    assert np.abs(gradients.features[found.rows]).sum(axis=1).min() > 0
    assert appearance._leaves[0].grad.abs().sum() > 0
    learning = [*appearance.triplane.named_parameters(), *appearance.colours.named_parameters()]
    lazy = [name for name, p in learning if p.grad is None or not p.grad.abs().sum() > 0]
    assert lazy in ([], ["outside"])  # what is in sight may all be within the box


ALL_SEEN = torch.ones(8, 11)


def pictures_of(appearance, view, visible):
    parameters = {name: torch.from_numpy(v) for name, v in opaque(appearance).state_dict().items()}
    return appearance.pictures(view, visible, parameters, VIEW)


def test_the_look_of_a_place_is_that_of_the_pixels_there():
    """Half of a photograph turns red: so do about half of the places on the planes, and the others stay as they are."""
    pixels = np.full((2, HEIGHT, WIDTH, 3), 128, np.uint8)
    pixels[1, :, : WIDTH // 2] = (255, 0, 0)
    appearance = restless(appearance_of(pixels=pixels))
    with torch.no_grad():
        before, after = (pictures_of(appearance, view, ALL_SEEN) for view in (0, 1))
    changed = (before != after).any(dim=1)
    assert 0.3 < float(changed.sum() / (before[:, [3, 7]] > 0).any(dim=1).sum()) < 0.7
    assert torch.equal(before[:, 3], after[:, 3])  # the points are the same, their colours are not


def test_what_is_masked_or_hidden_is_not_lifted():
    ignored, half = np.zeros((HEIGHT, WIDTH), bool), ALL_SEEN.clone()
    ignored[:, :20], half[:, 5:] = True, 0.4

    def points(visible, hidden=()):
        return float((pictures_of(appearance_of(ignored=hidden), 0, visible)[:, 3] > 0).float().sum())

    everything = points(ALL_SEEN)
    assert points(torch.full((8, 11), 0.4)) == 0
    assert 0 < points(half) < everything
    assert 0 < points(ALL_SEEN, [ignored, None]) < everything


def test_the_mask_learns_at_the_price_of_the_step():
    """By m [h', w'] of the loss: a part that its pixels' losses give, and 2 price (m - 1) / (h' w')."""
    appearance = appearance_of(replace(SEEING, visible_from=0.0), iterations=101)
    rule = PerceptualObjective(appearance._images, 0.2, appearance)
    image, gradients = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32), []
    for iteration in (0, 100):
        appearance._encoded(0)
        rule(image, 0, iteration, BufferPool())
        gradients.append(appearance.visible.grad)
    hidden = 1 - appearance.visible.detach()
    assert torch.allclose(gradients[0] - gradients[1], -2 * 0.3 * hidden / hidden.numel(), atol=1e-7)
    assert hidden.min() > 0.01
