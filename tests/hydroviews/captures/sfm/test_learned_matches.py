"""Learned features: which pairs are matched, which matches stay on the lens."""

import numpy as np
import pytest

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.learned import ranking
from hydroviews.captures.sfm.learned.ranking import ranked_pairs, shortlist
from hydroviews.captures.sfm.learned.stationary import without_stationary

RADIUS = 4.0


def directions(random, count):
    """Descriptors [K, 64] of length 1, which are unlike one another."""
    vectors = random.normal(size=(count, 64)).astype(np.float32)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def kept_of(moves, *others):
    """Which matches of pair (0, 1) are kept, by the moves [M, 2] of features; others are moves to further views."""
    base = np.random.default_rng(0).uniform(0, 300, (len(moves), 2))
    places = [base + shift for shift in (0, moves, *others)]
    views = [Features(place.astype(np.float32), np.zeros((len(moves), 64), np.float32)) for place in places]
    same = np.repeat(np.arange(len(moves))[:, None], 2, axis=1)
    return without_stationary(views, {(0, i): same for i in range(1, len(views))}, RADIUS)[0, 1][:, 0].tolist()


def test_drops_are_left_out_where_the_scene_moves():
    random = np.random.default_rng(1)
    drops, scene = random.normal((0, 0), 0.7, (60, 2)), random.normal((25, -3), 6, (40, 2))
    assert kept_of(np.concatenate([drops, scene])) == list(range(60, 100))


@pytest.mark.parametrize("pixels", [0.0, 1.0, 2.5, 4.0, 6.0, 10.0])
def test_a_tripod_and_a_slow_film_keep_their_matches(pixels):
    """All features move as little: 0 to 10 pixels from view to view, with half as much of parallax."""
    moves = np.random.default_rng(2).normal((pixels, 0), 0.5 + pixels / 4, (300, 2))
    assert len(kept_of(moves)) == 300


def test_drops_are_left_out_of_pairs_that_share_nothing_else():
    """A pair of nothing but drops looks as a tripod does; another pair, whose scene moved, has shown what they are."""
    random = np.random.default_rng(3)
    drops = random.normal(0, 0.7, (50, 2))
    moving = np.concatenate([drops[:30], random.normal(30, 0.7, (20, 2))])
    assert kept_of(drops, moving) == list(range(30, 50))


@pytest.fixture
def ring():
    """Twenty-four views around a thing: each shares features with five on either side, and all have drops in place."""
    random = np.random.default_rng(5)
    drops, pool = directions(random, 20), directions(random, 24 * 10)
    fixed = random.uniform(0, 300, (20, 2))
    views = []
    for i in range(24):
        seen = np.arange(i * 10, i * 10 + 60) % len(pool)
        places = np.concatenate([random.uniform(0, 300, (60, 2)), fixed])
        views.append(Features(places.astype(np.float32), np.concatenate([pool[seen], drops])))
    return views


def steps(pairs, count=24):
    return {min(j - i, count - (j - i)) for i, j in pairs}


def test_views_with_most_in_common_are_ranked_first_and_drops_do_not_count(ring, monkeypatch):
    assert steps(ranked_pairs(ring, RADIUS)) == {1, 2, 3, 4, 5}
    monkeypatch.setattr(ranking, "BEST", 2)
    assert {(0, 23), (0, 1), (5, 8), (20, 23)} <= ranked_pairs(ring, RADIUS)
    assert steps(ranked_pairs(ring, -1.0)) <= {1, 2, 3}


def test_global_descriptors_leave_as_many_partners_for_each_view(ring, monkeypatch):
    monkeypatch.setattr(ranking, "SHORTLISTED", 10)
    found = shortlist(ring)
    assert len(found) <= 24 * 10
    assert {(i, i + 1) for i in range(23)} <= found
    monkeypatch.setattr(ranking, "SHORTLISTED", 60)
    assert len(shortlist(ring)) == 24 * 23 / 2


def test_views_without_features_are_matched_with_their_neighbours_alone(ring):
    none = Features(np.zeros((0, 2), np.float32), np.zeros((0, 64), np.float32))
    found = ranked_pairs([*ring[:5], none, *ring[5:9]], RADIUS)
    assert {pair for pair in found if 5 in pair} == {(2, 5), (3, 5), (4, 5), (5, 6), (5, 7), (5, 8)}
    assert ranked_pairs([none, none, none], RADIUS) == {(0, 1), (0, 2), (1, 2)}
