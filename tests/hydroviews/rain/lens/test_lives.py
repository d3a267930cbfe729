from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from wet_lens import camera

from hydroviews.rain.lens.lives import LENSES, Lives, draw_lives
from hydroviews.rain.lens.patterns.bodies import Bodies, bodies_of, same_bodies
from hydroviews.rain.lens.patterns.pattern import draw_pattern
from hydroviews.rain.lens.patterns.water import GAP, water_at
from hydroviews.rain.lens.renewed import BankLens

PATTERN = draw_pattern(np.random.default_rng(5), 1)
SIDES = (np.sqrt(4 / 3), np.sqrt(3 / 4))


def lives(share: float, views: int = 30, width: int = 160, seed: int = 1) -> Lives:
    return draw_lives(replace(PATTERN, renewed=share, seed=seed), bank(width, seed), SIDES, views)


@cache
def bank(width: int, seed: int) -> list[Bodies]:
    lens = camera(width, 3 * width // 4)
    return [BankLens.of(replace(PATTERN, seed=seed), lens, number).bodies(lens) for number in range(LENSES)]


def shown(drawn: Lives, view: int) -> set[tuple[int, int]]:
    """Birth and body of all that is on the lens."""
    return {(born.birth, int(slot)) for born in drawn.at(view) for slot in born.slots}


def cover(drawn: Lives, view: int) -> float:
    """Share of the picture under large drops."""
    y, x = (np.mgrid[0:120:2, 0:160:2] + 0.5) / np.sqrt(120 * 160)
    under = np.zeros(y.shape, bool)
    for born in drawn.at(view):
        bodies = drawn.bank[born.lens]
        mine = np.isin(bodies.owners, born.slots[born.slots < bodies.large])
        for across, down, radius in bodies.disks[mine]:
            right, below = across + born.shift[0] * SIDES[0], down + born.shift[1] * SIDES[1]
            under |= (x - right) ** 2 + (y - below) ** 2 < radius**2
    return float(under.mean())


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 1.0])
def test_so_many_drops_are_new_from_one_view_to_the_next(share):
    drawn = lives(share)
    on_lens = [shown(drawn, view) for view in range(30)]
    new = [len(now - before) / len(now) for before, now in pairwise(on_lens)]
    assert np.mean(new) == pytest.approx(share, abs=0.04)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_as_much_is_covered_at_all_shares_and_times(share):
    wiped = np.mean([cover(lives(1.0), view) for view in range(0, 30, 3)])
    assert np.mean([cover(lives(share), view) for view in range(9, 30, 3)]) == pytest.approx(wiped, rel=0.15)


def test_what_is_there_follows_from_the_view_alone():
    drawn, again = lives(0.4), lives(0.4)
    backwards = [shown(drawn, view) for view in reversed(range(30))]
    assert backwards[::-1] == [shown(again, view) for view in range(30)]
    assert shown(lives(0.4, views=60), 7) == shown(lives(0.4, width=320), 7) == shown(drawn, 7)
    assert shown(lives(0.4, seed=2), 7) != shown(drawn, 7)


def test_no_drop_touches_one_of_another_generation():
    drawn, places = lives(0.5), []
    for born in drawn.at(12):
        bodies = drawn.bank[born.lens]
        disks = bodies.disks[np.isin(bodies.owners, born.slots)] + [*np.multiply(born.shift, SIDES), 0]
        places.append(np.column_stack([disks, np.full(len(disks), born.birth)]))
    x, y, radius, birth = np.concatenate(places).T
    apart = np.hypot(x[:, None] - x, y[:, None] - y) >= GAP * (radius[:, None] + radius) - 1e-12
    assert np.all(apart | (birth[:, None] == birth))
    assert len(np.unique(birth)) > 3


def test_bodies_keep_their_identity_while_they_grow_merge_and_run():
    pattern = replace(PATTERN, growth=0.3, rivulets=2)
    first, last = water_at(pattern, SIDES, 0.0), water_at(pattern, SIDES, 1.0)
    bodies, now = bodies_of(first), bodies_of(last)
    same = same_bodies(last, bodies, now)
    assert same[:2].tolist() == [0, 1]
    assert same_bodies(first, bodies, bodies).tolist() == list(range(len(bodies)))
    large = same[2 : now.large]
    middles = now.disks[now.starts[2 : now.large], :2]
    moved = np.linalg.norm(bodies.disks[bodies.starts[large], :2] - middles, axis=1)
    assert np.median(moved) == 0
    assert len(np.unique(large)) == len(large)
