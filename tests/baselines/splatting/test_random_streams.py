"""Random numbers of one purpose are the same whoever else draws, and no two purposes share theirs."""

import numpy as np
import pytest

from baselines.splatting.schedule import Stream, random_stream

NAMES = ["VIEW_ORDER", "SPLITTING", "RELOCATION", "NOISE", "DROPOUT", "ABSENCE", "INLIERS", "LAYERS", "START"]


@pytest.mark.parametrize(("number", "name"), enumerate(NAMES, 1))
def test_numbers_are_those_of_earlier_runs(number, name):
    for seed, index in ((0, 7), (3, 5)):
        expected = np.random.default_rng((seed, number, index)).random()
        assert random_stream(seed, Stream[name], index).random() == expected
