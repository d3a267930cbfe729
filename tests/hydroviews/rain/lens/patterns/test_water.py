import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from hydroviews.rain.lens.patterns.pattern import RaindropPattern, draw_pattern
from hydroviews.rain.lens.patterns.runs import draw_rivulets
from hydroviews.rain.lens.patterns.water import TOUCH, place_drops, water_at

EXTENT = (1.2, 1 / 1.2)
PATTERN = replace(draw_pattern(np.random.default_rng(3), 2), coverage=0.15, rivulets=3, growth=0.12, seed=0)


def all_disks(drops) -> np.ndarray:
    return np.array([disk for drop in drops for disk in drop.outline.disks])


def reach(drops) -> np.ndarray:
    """Distances between disks of different drops, over the sums of their radii."""
    disks = all_disks(drops)
    owner = np.repeat(np.arange(len(drops)), [len(drop.outline.disks) for drop in drops])
    apart = np.linalg.norm(disks[:, None, :2] - disks[None, :, :2], axis=-1)
    return (apart / (disks[:, None, 2] + disks[:, 2]))[owner[:, None] != owner]


def test_the_same_generator_draws_the_same_pattern_and_it_goes_through_json():
    first, second = (draw_pattern(np.random.default_rng(4), 1) for _ in range(2))
    assert first == second
    loaded = json.loads(json.dumps(asdict(first)))
    assert RaindropPattern(**{**loaded, "air": tuple(loaded["air"])}) == first
    assert draw_pattern(np.random.default_rng(5), 1) != first


@pytest.mark.parametrize("extent", [EXTENT, (0.6, 1.6), (10**0.5, 0.1**0.5), (1.0, 1.0)])
def test_drops_lie_apart_and_cover_what_was_asked(extent):
    drops = place_drops(PATTERN, extent)
    assert drops == place_drops(PATTERN, extent)
    assert reach(drops).min() > TOUCH
    areas = [np.pi * drop.outline.radius**2 for drop in drops]
    assert 0 <= sum(areas) - 0.15 * 1.1**2 * extent[0] * extent[1] < max(areas)


def test_more_coverage_and_droplets_leave_what_is_there_in_place():
    def still(share, droplets):
        return water_at(replace(PATTERN, rivulets=0, coverage=share, droplets=droplets), EXTENT, 0.0)

    few, many = still(0.05, 100).drops, still(0.2, 500).drops
    assert many[: len(few)] == few
    assert len(many) > 2 * len(few)
    dry, wet = still(0.0, 100).droplets, still(0.0, 500).droplets
    assert np.array_equal(wet[: len(dry)], dry)


def test_drops_grow_slowly_and_stay_where_they_are():
    pattern = replace(PATTERN, rivulets=0, coverage=0.03, growth=0.05)
    start, end = (water_at(pattern, EXTENT, moment).drops for moment in (0.0, 1.0))
    growth = np.array([b.outline.radius / a.outline.radius for a, b in zip(start, end, strict=True)])
    assert 1 < growth.min() < growth.max() <= 1.05
    np.testing.assert_array_equal(all_disks(start)[:, :2], all_disks(end)[:, :2])


def test_drops_that_touch_merge():
    few, many = (water_at(replace(PATTERN, rivulets=0, growth=growth), EXTENT, 1.0).drops for growth in (0.0, 0.4))
    assert len(many) < len(few)
    before, after = (sum(drop.outline.radius**3 for drop in drops) for drops in (few, many))
    assert 1.2 * before < after <= 1.4**3 * before
    assert max(len(drop.outline.disks) for drop in many) <= 3
    assert reach(many).min() >= TOUCH


def test_running_drops_go_down_and_leave_beads_and_no_drops_in_their_way():
    start, end = (draw_rivulets(PATTERN, EXTENT, moment) for moment in (0.0, 1.0))
    assert len(start) == len(end) == 3
    for before, after in zip(start, end, strict=True):
        assert len(after.way) > len(before.way)
        np.testing.assert_array_equal(after.way[: len(before.way)], before.way)
        assert np.all(np.diff(after.way[:, 1]) > 0)
    water = water_at(PATTERN, EXTENT, 1.0)
    disks = all_disks(water.drops)
    for rivulet in water.rivulets:
        room = np.linalg.norm(rivulet.way[:, None] - disks[None, :, :2], axis=-1) - disks[:, 2]
        assert room.min() > rivulet.start_radius
        assert rivulet.radius >= rivulet.start_radius
    assert max(len(rivulet.beads) for rivulet in water.rivulets) > 3


def test_where_drops_have_run_there_are_no_droplets_but_their_own_beads():
    water = water_at(replace(PATTERN, coverage=0.05, droplets=1500), EXTENT, 1.0)
    beads = {tuple(bead) for rivulet in water.rivulets for bead in rivulet.beads.tolist()}
    others = np.array([droplet for droplet in water.droplets.tolist() if tuple(droplet) not in beads])
    assert len(others) > 100
    assert all(rivulet.clear_of_track(others).all() for rivulet in water.rivulets)
