"""Random numbers of one purpose are the same whoever else draws, and no two purposes share theirs."""

from itertools import combinations

import numpy as np
import pytest

from baselines.splatting.schedule import Stream, random_stream


@pytest.mark.parametrize(("one", "other"), combinations(Stream, 2))
def test_purposes_draw_different_numbers(one, other):
    assert random_stream(3, one, 5).random() != random_stream(3, other, 5).random()
    assert len({random_stream(seed, one, index).random() for seed in range(3) for index in range(3)}) == 9


def test_numbers_are_those_of_earlier_runs():
    expected = {"VIEW_ORDER": 1, "SPLITTING": 2, "RELOCATION": 3, "NOISE": 4, "DROPOUT": 5, "ABSENCE": 6}
    for name, number in expected.items():
        assert random_stream(0, Stream[name], 7).random() == np.random.default_rng((0, number, 7)).random()
