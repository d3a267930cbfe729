"""Upright photographs among others: each shape has its drops where they are in its pictures."""

import numpy as np
import panorama
import pytest

from deraings.rain_model.drops import LensDrops, LensDropsConfig
from deraings.rain_model.drops_by_shape import DropsByShape

CONFIG = LensDropsConfig(start=0, every=1, min_share=0.01)
STEPS, COUNT, SIZE = 100, 12, (90, 120)
PLACES = (slice(20, 50), slice(20, 50)), (slice(60, 90), slice(40, 70))  # of the drop: in wide and in upright pictures


@pytest.fixture(scope="module")
def views():
    """Photographs and their scene, wide and upright in turn, behind a drop."""
    scene = list(panorama.views_of(panorama.paint(size=(250, 400)), 2 * COUNT, size=SIZE))
    scene = [view if i % 2 == 0 else np.ascontiguousarray(np.rot90(view)) for i, view in enumerate(scene)]
    photographs = [view.copy() for view in scene]
    for i, photograph in enumerate(photographs):
        photograph[PLACES[i % 2]] = panorama.shaded_drop(30, 30)
    return [panorama.eight_bit(photograph[None])[0] for photograph in photographs], scene


def learned(drops, pictures, scene):
    for view, (picture, seen) in enumerate(zip(pictures, scene, strict=True)):
        drops.update(picture / np.float32(255), seen, view)
    return drops


def test_each_shape_has_its_drops(views, caplog):
    caplog.set_level("INFO")
    pictures, scene = views
    drops = learned(DropsByShape(pictures, STEPS, CONFIG, [None] * len(pictures)), pictures, scene)
    assert "2 shapes (12, 12)" in caplog.text
    assert drops.staying == drops.lenses[0].staying > 0
    for view in (0, 1):
        alpha = drops.layer(view, scene[view].shape[:2], STEPS).alpha
        assert alpha[PLACES[view]].mean() > 0.6
        alpha[PLACES[view]] = 0
        assert alpha.mean() < 0.05


def test_photographs_of_one_shape_are_one_lens(views, caplog):
    caplog.set_level("INFO")
    pictures, scene = ([*part[::2]] for part in views)
    kinds = (kind(pictures, STEPS, CONFIG, [None] * len(pictures)) for kind in (LensDrops, DropsByShape))
    one, shaped = (learned(drops, pictures, scene) for drops in kinds)
    assert not caplog.text
    assert np.array_equal(one.layer(3, SIZE, STEPS).alpha, shaped.layer(3, SIZE, STEPS).alpha)


def test_what_was_learned_of_every_shape_comes_back(views):
    pictures, scene = views
    new, old = (DropsByShape(pictures, STEPS, CONFIG, [None] * len(pictures)) for _ in range(2))
    learned(old, pictures, scene)
    new.load_state_dict(old.state_dict())
    for view in (0, 1):
        found = [drops.layer(view, scene[view].shape[:2], STEPS).alpha for drops in (old, new)]
        assert np.array_equal(*found)
