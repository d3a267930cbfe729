"""Encodings of positions and directions."""

import numpy as np
import torch

from baselines.volumetric.fields.encodings import positional


def test_positions_are_followed_by_sines_and_cosines_of_doubled_frequencies():
    x = torch.tensor([[0.25, -0.5, 0.1]])
    expected = [0.25, -0.5, 0.1]
    for wave in (np.sin, np.cos):
        expected += [wave(2.0**k * np.pi * value) for k in range(2) for value in (0.25, -0.5, 0.1)]
    np.testing.assert_allclose(positional(x, 2).numpy()[0], expected, atol=1e-6)
