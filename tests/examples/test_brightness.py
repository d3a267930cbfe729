"""The example of a metric of one's own; `test_toy_metric.py` registers it and scores a run."""

import numpy as np
import pytest

from examples.brightness import brightness_error


def test_it_is_the_distance_of_the_means_of_what_is_shown():
    target = np.full((4, 6, 3), 0.5, np.float32)
    image = target.copy()
    image[:, :3] += np.float32(10 / 255)
    assert brightness_error(image, target) == pytest.approx(5, abs=1e-4)
    ignored = np.zeros((4, 6), bool)
    ignored[:, 3:] = True
    assert brightness_error(image, target, ignored=ignored) == pytest.approx(10, abs=1e-4)
