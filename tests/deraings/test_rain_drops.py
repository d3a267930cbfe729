import numpy as np
import panorama
import pytest

from deraings.rain_drops import DropConfig, Drops, Spread

DISK = (slice(18, 30), slice(25, 37))  # of the lens, in pixels


def behind_drops(views):
    """The views with one drop that shows a grey of its own, a little lighter where the scene is."""
    wet = views.copy()
    wet[(slice(None), *DISK)] = 0.5 + 0.1 * (views.mean(axis=(1, 2), keepdims=True) - 0.4)
    return wet


def watch(scene, photographs, config=None, epochs=3):
    """Drops that have seen all photographs of a known scene, learned with an error of 0.02."""
    pictures = panorama.eight_bit(photographs)
    config = config or DropConfig()
    drops = Drops(Spread(pictures, config), len(scene), 100, config)
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape).astype(np.float32)
    for view in list(range(len(scene))) * epochs:
        drops.observe(photographs[view] - scene[view] + error[view], view)
    return drops


def mask_of(drops, view=0):
    weights = drops.weights(view, (panorama.HEIGHT, panorama.WIDTH), 100)
    return np.zeros((panorama.HEIGHT, panorama.WIDTH), bool) if weights is None else weights < 0.5


def test_a_drop_is_found_and_nothing_else():
    scene = panorama.views_of(panorama.paint(), 14)
    mask = mask_of(watch(scene, behind_drops(scene)))
    assert mask[DISK].mean() > 0.95
    mask[DISK] = False
    assert mask.mean() < 0.05


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


def test_water_everywhere_leaves_part_of_the_lens():
    scene = panorama.views_of(panorama.paint(), 14)
    noise = np.random.default_rng(5).uniform(0.45, 0.55, scene.shape).astype(np.float32)
    assert 0.3 < mask_of(watch(scene, noise)).mean() <= DropConfig().most + 0.01


def test_a_scene_that_is_not_learned_yet_is_no_water():
    scene = panorama.views_of(panorama.paint(), 14)
    mean = np.broadcast_to(scene.mean(axis=(0, 1, 2)), scene.shape)
    assert mask_of(watch(mean, scene)).mean() < 0.1


def test_too_few_views_tell_nothing():
    scene = panorama.views_of(panorama.paint(), 3)
    assert not mask_of(watch(scene, behind_drops(scene))).any()


def test_not_before_its_start_and_at_any_size():
    scene = panorama.views_of(panorama.paint(), 14)
    drops = watch(scene, behind_drops(scene), DropConfig(long_side=40))
    assert drops.weights(0, (panorama.HEIGHT, panorama.WIDTH), 0) is None
    weights = drops.weights(0, (23, 31), 100)
    assert weights.shape == (23, 31)
    assert weights.min() == pytest.approx(0, abs=0.1)
    assert weights.max() == 1
