"""What networks see of photographs, and which rays see the mean look."""

import numpy as np
import pytest
import torch

from baselines.training.images import TrainingImages
from baselines.volumetric.rays.photographs import as_seen, rays_of_the_mean, small_pictures


def test_what_is_hidden_of_a_picture_is_not_seen():
    hidden = np.zeros((240, 320), bool)
    hidden[:, 100:200] = True
    looks = []
    for value in (0, 255):
        picture = np.full((240, 320, 3), 100, np.uint8)
        picture[hidden] = value
        looks.append(small_pictures(TrainingImages([picture], [hidden]), 16))
    assert torch.equal(*looks)
    assert looks[0].max() == 100
    np.testing.assert_allclose(as_seen(torch.tensor([0, 255], dtype=torch.uint8)), [-1, 1])


@pytest.mark.parametrize("share", [0.0, 0.25, 0.3, 0.5, 1.0])
def test_rays_of_the_mean_look_are_a_share_spread_evenly(share):
    chosen = rays_of_the_mean(1000, share, torch.device("cpu"))
    assert abs(int(chosen.sum()) - 1000 * share) <= 1
    parts = chosen.view(10, 100).sum(1)
    assert int(parts.max() - parts.min()) <= 1
