"""WildGaussians: what it is for, its look of each view, and its sky."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from against_float64 import leaves_of_sh_sets
from disturbed import assert_found, disturbed, fitted, occluded
from looks import hides_everything_and_says_so
from splats import BACKGROUND, camera, cloud, photographed
from trainings import PLAIN, UNSPARING, psnr

import baselines.wild_gaussians.method as wild
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.uncertainty import UncertaintyConfig
from baselines.splatting.appearance.gaussians import AppearanceGaussians, with_appearance
from baselines.splatting.backends import torch_rasterizer as reference
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import backward_sh_sets, render_sh_sets
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.images import read_images
from baselines.wild_gaussians.appearance import MIDDLE, AppearanceConfig, WildAppearance, toned
from baselines.wild_gaussians.mean_appearance import mean_appearance
from baselines.wild_gaussians.method import WildConfig, WildGaussians
from baselines.wild_gaussians.sky import DISTANCE, Bounds, bounds_of, fibonacci, in_upper_part, with_room, with_sky
from hydroviews.scene.scenes import Points

SPLATTING = replace(PLAIN, iterations=240, strategy=replace(UNSPARING, start=10, stop=150))
QUICK_APPEARANCE = AppearanceConfig(width=16, scale=0.3, rate=5e-3, view_rate=2e-2)
CONFIG = WildConfig(
    SPLATTING, QUICK_APPEARANCE, UncertaintyConfig("alexnet", start=60, warm_up=20, protected=0, rate=1e-2, every=2)
)
BRIEF = replace(CONFIG, splatting=replace(SPLATTING, iterations=16, checkpoint_seconds=0.0), sky=50)


def test_a_colour_cast_in_every_view_is_taken_off(tmp_path):
    scene = photographed(tmp_path, n_views=16)
    casts = np.random.default_rng(0).uniform(0.6, 1.0, (16, 3))
    casts /= casts.mean(axis=0) / 0.8
    cast = disturbed(scene, tmp_path / "cast", lambda image, index: image * casts[index])
    truth = disturbed(scene, tmp_path / "truth", lambda image, _: image * 0.8).test_views  # in the mean of all light
    plain = fitted(GaussianSplatting, SPLATTING, cast, tmp_path / "plain")
    ours = fitted(WildGaussians, replace(CONFIG, uncertainty=None), cast, tmp_path / "toned")
    assert psnr(ours, truth) > psnr(plain, truth) + 1.5


class Blocks:
    """Stands in for AlexNet, which sees too far for pictures this small: mean colours of 8x8 pixels, and a constant."""

    name, alike, unlike = "blocks", 0.02, 0.3

    def __call__(self, image):
        planes = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)
        mean = torch.nn.functional.avg_pool2d(planes, 8) - 0.4
        return torch.cat([mean, torch.full_like(mean[:1], 0.15)])


def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path, monkeypatch):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded")
    steady = replace(SPLATTING, iterations=400, strategy=DefaultStrategy(start=1000))
    off = replace(CONFIG, splatting=steady, appearance=None, uncertainty=None)
    taught = replace(CONFIG.uncertainty, start=80, first_lesson=30, rate=2e-2, prior=0.6, least=0.5, every=1)
    monkeypatch.setattr(wild, "calibrated", lambda *_: Blocks())
    without = fitted(WildGaussians, off, shown, tmp_path / "off")
    told = fitted(WildGaussians, replace(off, uncertainty=taught), shown, tmp_path / "on")
    assert psnr(told, scene.test_views) > psnr(without, scene.test_views) + 0.8
    assert_found(told, shown, scene)


def test_the_loss_is_l1_of_the_toned_look_and_ssim_of_the_plain_one(tmp_path):
    images = read_images(photographed(tmp_path, n_views=4).train_views)
    plain, photograph = (np.random.default_rng(k).random((36, 48, 3)).astype(np.float32) for k in range(2))
    exact, ours = images.pixels(0) / np.float32(255), wild.WildObjective(images, 0.2, None, None)
    usual_loss, usual_gradient = Objective(images)(photograph, 0, 0, BufferPool())
    loss, gradients = ours.compare([photograph, photograph], 0, 0, BufferPool())
    assert loss == pytest.approx(usual_loss, rel=1e-5)
    assert np.allclose(sum(gradients), usual_gradient, atol=1e-8)
    loss, (toned, other) = ours.compare([exact, plain], 0, 0, BufferPool())
    assert loss == pytest.approx(0.2 * Objective(images, 1.0)(plain, 0, 0, BufferPool())[0], rel=1e-5)
    assert not toned.any()
    assert other.any()


def test_masks_that_hide_everything_are_said(tmp_path, caplog):
    uncertain = replace(BRIEF.uncertainty, start=0, warm_up=0, prior=2.0)
    hides_everything_and_says_so(WildGaussians, replace(BRIEF, uncertainty=uncertain), tmp_path, caplog)


BOUNDS = Bounds(np.zeros(3), 1.5)
LIVELY = AppearanceConfig(width=16, scale=1.0)


def appearance(views=3, config=LIVELY, seed=0):
    return WildAppearance(views, BOUNDS, 100, config, seed)


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_toned_coefficients_are_toned_colours(degree):
    generator = torch.Generator().manual_seed(degree)
    numbers = torch.randn(20, (degree + 1) ** 2 + 3, 3, generator=generator, dtype=torch.float64)
    sh, gain, offset = numbers[:, :-3], numbers[:, -3], numbers[:, -2]
    basis = reference.basis(degree, torch.nn.functional.normalize(numbers[:, -1], dim=1))

    def colour(coefficients):
        return MIDDLE + (basis[:, :, None] * coefficients).sum(dim=1)

    assert torch.allclose(colour(toned(sh, gain, offset)), gain * colour(sh) + offset, atol=1e-12)


def test_gradients_are_those_of_float64():
    ours, twin = appearance(), appearance().double()
    gaussians, view = with_appearance(cloud(40, 1), ours), camera(24, 20)
    weights = [np.random.default_rng(k).normal(size=(20, 24, 3)).astype(np.float32) for k in range(2)]
    visible = AppearanceGaussians(gaussians, ours, view, 1, 1)
    _, state = render_sh_sets(visible.gaussians, visible.sh, view, BACKGROUND)
    gradients, by_sh_sets = backward_sh_sets(state, np.stack(weights))
    found = visible.backward(gradients.parameters, by_sh_sets, BufferPool())

    leaves = leaves_of_sh_sets(twin, gaussians, view, weights)
    for name, leaf in leaves.items():
        expected = leaf.grad.numpy()
        assert np.abs(getattr(found, name) - expected).max() < 2e-3 * np.abs(expected).max(), name
    for (name, mine), other in zip(ours.named_parameters(), twin.parameters(), strict=True):
        assert (mine.grad - other.grad).abs().max() < 2e-3 * other.grad.abs().max(), name
    assert ours.views.grad.any(dim=1).tolist() == [False, True, False]


def test_gaussians_look_as_in_the_mean_of_the_views_that_show_them():
    model, cameras = appearance(), [camera(24, 20), camera(24, 20, 0.05), camera(24, 20, np.pi, origin=(30, 0, 0))]
    means = np.array([[0, 0, 0], [30, 0, 0], [0, 90, 0]], np.float32)  # the third camera looks at the second
    gaussians = with_appearance(replace(cloud(3, 1, size=0.05), means=means), model)
    shown = mean_appearance(gaussians, model, cameras, 0.01, antialiased=False)
    assert shown.features is None
    parameters = {name: torch.from_numpy(value) for name, value in gaussians.state_dict().items()}
    with torch.no_grad():
        colours = [model.sh_sets(parameters, view, k, 1)[0].numpy() for k, view in enumerate(cameras)]
    assert np.allclose(shown.sh[0], (colours[0][0] + colours[1][0]) / 2, atol=5e-3)  # as large in both
    assert np.allclose(shown.sh[1], colours[2][1], atol=1e-5)
    assert np.abs(shown.sh[2] - gaussians.sh[2]).max() > 0.05  # seen nowhere: toned as all are in the mean
    assert np.abs(colours[0][0] - colours[1][0]).max() > 0.02


def test_it_starts_from_the_colours_as_they_are():
    model = appearance(config=AppearanceConfig())
    gaussians = with_appearance(cloud(40, 1), model)
    cameras = [camera(24, 20, angle) for angle in (0, 2, 4)]
    assert np.abs(mean_appearance(gaussians, model, cameras, 0.01, antialiased=False).sh - gaussians.sh).max() < 0.02


def test_points_are_spread_evenly_over_the_sphere():
    points = fibonacci(1000)
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    assert np.abs(points.mean(axis=0)).max() < 1e-2
    distances = np.linalg.norm(points[:, None] - points[None], axis=2) + 9 * np.eye(1000)
    spacing = np.sqrt(4 * np.pi / 1000)
    assert distances.min() > 0.7 * spacing
    assert distances.min(axis=1).max() < 1.1 * spacing


def test_the_upper_two_thirds_of_a_picture():
    view = camera(30, 30)
    pixels = np.array([[15, 1], [15, 19], [15, 21], [-1, 5], [29, 5]])
    rays = np.stack([(pixels[:, 0] - view.cx) / view.fx, (pixels[:, 1] - view.cy) / view.fy, np.ones(5)], axis=1)
    positions = 7 * rays @ view.world_to_camera[:3, :3] + view.centre
    assert in_upper_part(positions, [view]).tolist() == [True, True, False, False, True]
    assert not in_upper_part(2 * view.centre - positions, [view]).any()  # behind the camera


def test_the_sky_lies_behind_the_scene_and_in_view(tmp_path):
    scene = photographed(tmp_path, n_views=3)
    bounds = bounds_of(scene)
    assert np.allclose(bounds.centre, scene.points.positions.mean(axis=0))
    inside = np.linalg.norm(scene.points.positions - bounds.centre, axis=1) <= bounds.radius
    assert inside.mean() == pytest.approx(0.97, abs=0.01)

    n, wider = len(scene.points), with_sky(scene, bounds, 500)
    sky = wider.points.positions[n:]
    assert 20 < len(sky) < 400
    assert np.array_equal(wider.points.positions[:n], scene.points.positions)
    assert np.allclose(np.linalg.norm(sky - bounds.centre, axis=1), DISTANCE * bounds.radius)
    assert in_upper_part(sky, [view.camera for view in scene.train_views]).all()
    assert with_sky(scene, bounds, 0) is scene


def test_points_that_are_no_numbers_do_not_move_the_bounds_and_few_have_those_of_the_cameras_and_no_sky(tmp_path):
    scene = photographed(tmp_path, n_views=3)

    def of(positions):
        return replace(scene, points=Points(positions, np.zeros((len(positions), 3), np.uint8)))

    broken = of(np.concatenate([scene.points.positions, [[np.nan, 0, 0]]]))
    assert np.array_equal(bounds_of(broken).centre, bounds_of(scene).centre)
    few = of(scene.points.positions[:9])
    bounds = bounds_of(few)
    assert bounds.radius > 1
    assert with_sky(few, bounds, 500) is few


def test_gaussians_of_the_sky_may_be_as_large_as_they_are_far():
    bounds, config = Bounds(np.zeros(3), 2.0), TrainerConfig()
    roomy = with_room(config, bounds, 400, extent=2.0)
    assert roomy.strategy.prune_scale3d == pytest.approx(3 * 20 * np.sqrt(4 * np.pi / 400) / 2)
    assert replace(roomy, strategy=config.strategy) == config
    assert with_room(config, bounds, 0, 2.0) is config
    relocating = replace(config, strategy=MCMCStrategy())
    assert with_room(relocating, bounds, 400, 2.0) is relocating
