from dataclasses import replace

import cv2
import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.image_planes import surroundings
from deraings.rain_model.drops import DropLayer, LensDrops, LensDropsConfig
from hydroviews.scene.images import to_uint8

DISK = (slice(18, 30), slice(25, 37))  # of the lens, in pixels
INSIDE = (slice(20, 28), slice(27, 35))  # of it, two pixels from its edge


SHADING = panorama.shaded_drop(12, 12)


ANYWHERE = replace(LensDropsConfig(), min_share=0, usual=-2, fixed=-1)  # lines are believed wherever they are


def behind_drops(views):
    """The views with one drop that shows a shading of its own, a little lighter where the scene is."""
    wet = views.copy()
    wet[(slice(None), *DISK)] = SHADING + 0.1 * (views.mean(axis=(1, 2), keepdims=True) - 0.4)
    return wet


def looked_at(photographs, config=None, hidden=()):
    """A lens of which only the photographs are known."""
    return LensDrops([to_uint8(photograph) for photograph in photographs], 100, config or LensDropsConfig(), hidden)


def watch(scene, photographs, config=None, epochs=3):
    """Drops that have seen all photographs of a known scene, learned with an error of 0.02."""
    drops = looked_at(photographs, config)
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape).astype(np.float32)
    for view in list(range(len(scene))) * epochs:
        drops.update(photographs[view], scene[view] - error[view], view)
    return drops


def mask_of(drops, view=0):
    layer = layer_of(drops, view)
    return np.zeros((panorama.HEIGHT, panorama.WIDTH), bool) if layer is None else layer.alpha > 0.5


def layer_of(drops, view=0):
    return drops.layer(view, (panorama.HEIGHT, panorama.WIDTH), 100)


def test_a_drop_is_found_and_nothing_else():
    scene = panorama.views_of(panorama.paint(), 14)
    mask = mask_of(watch(scene, behind_drops(scene)))
    assert mask[DISK].mean() > 0.95
    mask[DISK] = False
    assert mask.mean() < 0.05


def test_a_passer_by_who_is_hidden_here_and_there_hides_no_drop():
    scene = panorama.views_of(panorama.paint(), 24)
    photographs = behind_drops(scene)
    masks = np.zeros(photographs.shape[:3], bool)
    for view, mask in enumerate(masks):
        mask[:, 5 * view % 60 : 5 * view % 60 + 20] = True  # over the drop in a third of the views
    drops = [looked_at(photographs), looked_at(np.where(masks[..., None], 0, photographs), hidden=masks)]
    for view, hidden in enumerate(masks):
        drops[0].update(photographs[view], scene[view], view)
        masked = np.where(hidden[..., None], np.float32(0), photographs[view])
        drops[1].update(masked, scene[view], view, 1 - hidden.astype(np.float32))
    expected, found = (d.line(0)[0] for d in drops)
    assert expected[INSIDE].min() > 0.7
    assert np.abs(found - expected)[INSIDE].max() < 0.1


def test_what_is_hidden_in_every_view_is_no_drop():
    scene = panorama.views_of(panorama.paint(), 14)
    shown = np.ones(scene.shape[1:3], np.float32)
    shown[DISK] = 0
    photographs = behind_drops(scene) * shown[..., None]
    drops = looked_at(photographs, LensDropsConfig(min_share=0), [shown == 0] * len(scene))
    for view in range(len(scene)):
        drops.update(photographs[view], scene[view], view, shown)
    assert not layer_of(drops).alpha[DISK].any()


@pytest.mark.parametrize("cover", [0.3, 0.7])
def test_a_drop_that_covers_in_part_is_a_line(cover):
    scene = panorama.views_of(panorama.paint(), 24)
    around = np.stack([surroundings(view) for view in scene])
    wet = scene.copy()
    light = cover * (SHADING + np.float32([-0.4, -0.3, -0.2]))
    wet[(slice(None), *DISK)] = ((1 - cover) * scene + cover * around)[(slice(None), *DISK)] + light
    layer = layer_of(watch(scene, wet, ANYWHERE))
    assert layer.alpha[INSIDE].mean() == pytest.approx(cover, abs=0.04)
    assert np.allclose(layer.light[INSIDE], light[2:-2, 2:-2], atol=0.06)
    seen, weights = layer.forward(scene[3], BufferPool())
    assert np.abs(seen - wet[3])[INSIDE].mean() < 0.02
    outside = np.ones(layer.alpha.shape, bool)
    outside[DISK[0].start - 2 : DISK[0].stop + 2, DISK[1].start - 2 : DISK[1].stop + 2] = False
    assert layer.alpha[outside].max() < 0.1
    assert (weights[outside] == 1).all()
    assert (np.abs(layer.light) <= layer.alpha[..., None]).all()


@pytest.mark.parametrize("follows", [0, 0.5, 1])
def test_a_drop_is_found_however_much_its_light_follows_its_surroundings(follows):
    scene = panorama.views_of(panorama.paint(), 24)
    around = np.stack([surroundings(view) for view in scene])
    light = follows * around + (1 - follows) * around.mean(axis=(0, 1, 2))
    wet = scene.copy()
    wet[(slice(None), *DISK)] = SHADING - 0.4 + light[(slice(None), *DISK)]
    drops = watch(scene, wet, ANYWHERE)
    assert np.median(layer_of(drops).alpha[INSIDE]) > 0.9


def test_what_is_too_fine_to_render_is_no_drop():
    scene = panorama.views_of(panorama.paint(), 24)
    smooth = np.stack([cv2.GaussianBlur(view, (0, 0), 2.0) for view in scene])
    assert not mask_of(watch(smooth, scene, LensDropsConfig(min_share=0))).any()


def test_dry_views_keep_every_pixel():
    scene = panorama.views_of(panorama.paint(), 14)
    assert not mask_of(watch(scene, scene)).any()


def test_a_white_wall_that_never_changes_is_no_drop():
    scene = panorama.views_of(panorama.paint(), 14)
    scene[:, :20] = 0.95
    assert not mask_of(watch(scene, scene))[:20].any()


def test_a_drop_that_came_late_is_not_looked_for_early():
    scene = panorama.views_of(panorama.paint(), 36)
    photographs = np.concatenate([scene[:18], behind_drops(scene[18:])])
    drops = watch(scene, photographs, epochs=4)
    assert mask_of(drops, 35)[DISK].mean() > 0.9
    assert mask_of(drops, 0)[DISK].mean() < 0.1


def test_water_nearly_everywhere_leaves_part_of_the_lens():
    scene = panorama.views_of(panorama.paint(), 14)
    water = np.random.default_rng(5).uniform(0.4, 0.6, scene.shape[1:]) + np.zeros_like(scene)
    water[:, :, :12] = scene[:, :, :12]
    assert 0.3 < mask_of(watch(scene, water.astype(np.float32))).mean() <= LensDropsConfig().max_share + 0.01


def test_a_scene_that_is_not_learned_yet_is_no_water():
    scene = panorama.views_of(panorama.paint(), 14)
    mean = np.broadcast_to(scene.mean(axis=(0, 1, 2)), scene.shape)
    assert mask_of(watch(mean, scene)).mean() < 0.25  # single pixels, by chance: the render is nothing but noise


def test_a_scene_that_is_learned_wrong_is_no_drop():
    scene = panorama.views_of(panorama.paint(), 24)
    wrong = np.concatenate([panorama.views_of(panorama.paint(7), 24)[:, :25], scene[:, 25:]], axis=1)  # trees in wind
    assert mask_of(watch(wrong, scene, ANYWHERE))[:25].mean() > 0.5  # as lines alone have it
    assert mask_of(watch(wrong, scene)).mean() < 0.05


def test_a_drop_before_a_scene_that_is_learned_wrong_is_found():
    scene = panorama.views_of(panorama.paint(), 24)
    wrong = panorama.views_of(panorama.paint(7), 24)
    mask = mask_of(watch(wrong, behind_drops(scene)))
    assert mask[DISK].mean() > 0.8
    mask[DISK[0].start - 3 : DISK[0].stop + 3, DISK[1].start - 3 : DISK[1].stop + 3] = False
    assert mask.mean() < 0.1


def test_cameras_that_do_not_move_show_no_drops():
    scene = np.repeat(panorama.views_of(panorama.paint(), 1), 14, axis=0)
    jitter = 0.02 * np.random.default_rng(4).standard_normal(scene.shape).astype(np.float32)
    assert not mask_of(watch(np.repeat(panorama.views_of(panorama.paint(7), 1), 14, axis=0), scene + jitter)).any()


def test_too_few_views_tell_nothing():
    scene = panorama.views_of(panorama.paint(), 3)
    assert layer_of(watch(scene, behind_drops(scene))) is None


def test_not_before_its_start_and_at_any_size():
    scene = panorama.views_of(panorama.paint(), 14)
    drops = watch(scene, behind_drops(scene), LensDropsConfig(long_side=40))
    assert drops.layer(0, (panorama.HEIGHT, panorama.WIDTH), 0) is None
    layer = drops.layer(0, (23, 31), 100)
    assert layer.alpha.shape == (23, 31)
    assert layer.light.shape == (23, 31, 3)
    _, weights = layer.forward(np.zeros((23, 31, 3), np.float32), BufferPool())
    assert weights.min() == pytest.approx(0, abs=0.1)
    assert weights.max() == 1


def test_what_drops_show_and_what_is_left_of_a_gradient_are_the_plain_formulas():
    rng = np.random.default_rng(0)
    image, light, gradient = rng.uniform(0, 1, (3, 13, 17, 3)).astype(np.float32)
    alpha = rng.uniform(0, 1, (13, 17)).astype(np.float32)
    layer, buffers = DropLayer(alpha, light, 0.3, 0.75), BufferPool()
    seen, weights = layer.forward(image, buffers)
    left = (1 - alpha)[..., None]
    fall = np.clip((0.75 - alpha) / (0.75 - 0.3), 0, 1)
    assert np.allclose(seen, left * image + (1 - left) * surroundings(image) + light, atol=1e-6)
    assert np.allclose(weights, fall * fall * (3 - 2 * fall), atol=1e-5)
    assert np.allclose(layer.backward(gradient, buffers), left * gradient, atol=1e-6)


def test_lines_are_those_of_least_squares_over_the_views():
    config = replace(ANYWHERE, noise=0.0, clear=-2.0, wet=-1.0, max_time_knots=1)
    rng = np.random.default_rng(0)
    seen = rng.uniform(0.2, 0.8, (9, 5, 7, 3)).astype(np.float32)
    photographs = (0.4 * seen + 0.2 + 0.05 * rng.standard_normal(seen.shape)).astype(np.float32)
    drops = looked_at(photographs, config)
    for view in range(9):
        drops.update(photographs[view], seen[view], view)
    cover, light = drops.line(0)
    weights = (1 - 1 / 9) ** np.arange(8, -1, -1)  # what running means remember
    weights = (weights / weights.sum())[:, None, None, None]
    around = np.stack([surroundings(view) for view in seen])
    shown, expected = (values.astype(np.float64) - around for values in (photographs, seen))
    means = [(weights * values).sum(axis=0) for values in (shown, expected)]
    together = (weights * (shown - means[0]) * (expected - means[1])).sum(axis=0).mean(axis=2)
    alone = (weights * (expected - means[1]) ** 2).sum(axis=0).mean(axis=2)
    expected = np.clip(1 - together / alone, 0, 1)
    assert np.allclose(cover, expected, atol=1e-4)
    rest = means[0] - (1 - expected)[..., None] * means[1]
    assert np.allclose(light, np.clip(rest, -expected[..., None], expected[..., None]), atol=1e-4)


def test_before_any_view_nothing_is_known():
    drops = looked_at(panorama.views_of(panorama.paint(), 14))
    assert not any(plane.any() for plane in drops.line(0))
    assert layer_of(drops) is None


def test_a_drop_that_one_photograph_hides_stays():
    photographs = behind_drops(panorama.views_of(panorama.paint(), 14))
    hidden = np.zeros(photographs.shape[1:3], bool)
    hidden[DISK] = True
    dark = np.concatenate([np.where(hidden[..., None], 0, photographs[:1]), photographs[1:]])
    assert looked_at(dark, hidden=[hidden, *[None] * 13]).staying > 0.5 * looked_at(photographs).staying > 0


def test_the_share_of_the_lens_that_stays_is_of_what_any_photograph_shows():
    photographs = behind_drops(panorama.views_of(panorama.paint(), 14))
    hidden = np.ones(photographs.shape[1:3], bool)
    hidden[10:40, 15:50] = False  # around the drop
    dark = np.where(hidden[..., None], 0, photographs)
    shown = looked_at(photographs).staying, looked_at(dark, hidden=[hidden] * 14).staying
    assert 0.02 < 2 * shown[0] < shown[1]
    assert looked_at(dark, hidden=[np.ones_like(hidden)] * 14).staying == 0


def test_drops_cover_as_much_of_the_lens_as_is_allowed_and_are_no_lighter_than_they_cover():
    alpha = np.linspace(0.3, 1, panorama.HEIGHT * panorama.WIDTH, dtype=np.float32).reshape(panorama.HEIGHT, -1)
    drops = looked_at(panorama.views_of(panorama.paint(), 14))
    drops.line = lambda view: (alpha.copy(), np.repeat(alpha[..., None], 3, axis=2))
    layer = layer_of(drops)
    assert (layer.alpha > 0.5).mean() == pytest.approx(LensDropsConfig().max_share, abs=0.01)
    assert (layer.light <= layer.alpha[..., None]).all()
