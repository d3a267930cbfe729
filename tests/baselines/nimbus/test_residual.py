import logging

import numpy as np
import pytest

from baselines.nimbus.config import ResidualConfig
from baselines.nimbus.residual import Residuals, beyond

CONFIG = ResidualConfig(threshold=0.1, first=0.2, every=0.1)
GREY = np.full((4, 6, 3), 0.5, np.float32)


def photograph(places, value=0.9):
    picture = GREY.copy()
    for place in places:
        picture[place] = value
    return picture


def test_a_pixel_is_the_residuals_if_it_is_off_by_more_than_the_threshold():
    picture = photograph([(0, 1)])
    picture[1, 2] = 0.2  # darker than expected
    picture[2, 3] = 0.59  # below the threshold
    picture[3, 4] = (0.8, 0.5, 0.5)  # a tenth in the mean is not beyond
    picture[3, 5] = (0.81, 0.5, 0.51)
    assert sorted(zip(*np.nonzero(beyond(picture, GREY, 0.1)), strict=True)) == [(0, 1), (3, 5)]
    hidden = np.zeros((4, 6), bool)
    hidden[0, 1] = True
    assert not beyond(picture, GREY, 0.1, hidden)[0, 1]


def test_it_begins_after_a_while_and_is_made_anew_when_due():
    residuals = Residuals(CONFIG, 2, 100)
    assert residuals.of(photograph([(0, 0)]), GREY, 0, 19, None) is None
    assert residuals.share == 0
    first = residuals.of(photograph([(0, 0)]), GREY, 0, 20, None)
    assert first.sum() == 1
    assert residuals.of(GREY, GREY, 0, 29, None) is first
    assert not residuals.of(GREY, GREY, 0, 30, None).any()
    assert residuals.of(photograph([(0, 0)])[::2, ::2], GREY[::2, ::2], 0, 31, None).shape == (2, 3)  # another size
    assert residuals.share == pytest.approx(1 / 6)
    assert Residuals(None, 2, 100).of(GREY, GREY, 0, 99, None) is None


def test_a_residual_that_eats_everything_is_said_once(caplog):
    residuals = Residuals(CONFIG, 2, 100)
    with caplog.at_level(logging.WARNING):
        residuals.of(GREY + 0.4, GREY, 0, 20, None)
        assert not caplog.records  # the other view has not been seen
        for iteration in range(21, 90):
            residuals.of(GREY + 0.4, GREY, iteration % 2, iteration, None)
    assert [record.message for record in caplog.records if "residuals hold 100 %" in record.message]
    assert len(caplog.records) == 1
