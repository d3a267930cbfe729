"""Steps of an objective on renders that stay as they are, compared to the bit."""

import numpy as np
from pretended_network import PretendedNetwork

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.rain_model.rainfall import Rainfall


def steps(objective, images, first, last):
    """Losses and gradients of some steps."""
    buffers, out = BufferPool(), []
    for step in range(first, last):
        view = step % len(images)
        loss, gradient = objective(images[view], view, step, buffers)
        out.append((loss, gradient.copy()))
    return out


def let_it_rain(objective, even, streaks=()):
    """An objective behind rain of median cover `even` and single streaks [N, H, W]; without rain if it is 0."""
    images = objective.images
    dry = [images.pixels(view) / np.float32(255) for view in range(len(images))]
    covers = [np.zeros(picture.shape[:2], np.float32) for picture in dry]
    rain = Rainfall(images, PretendedNetwork(dry, covers, photographs=dry), brightness=0.88)
    rain.even_alpha = even
    for view, deviation in enumerate(streaks):
        rain._alphas[view] = (255 * np.clip(even + deviation, 0, 1)).astype(np.uint8)
    objective.model.rainfall = rain if even else None
    return objective


def assert_same_steps(found, expected):
    """Losses and gradients are the same."""
    for (loss, gradient), (other, g) in zip(found, expected, strict=True):
        assert loss == other
        assert np.array_equal(gradient, g)


def resumed(whole, first, second, images, at, end):
    """The steps of an objective that takes all; its like resumes what a third began, and must do the same."""
    everything = steps(whole, images, 0, end)
    steps(first, images, 0, at)
    second.load_state_dict({name: value.copy() for name, value in first.state_dict().items()})
    assert_same_steps(steps(second, images, at, end), everything[at:])
    assert all(np.array_equal(value, second.state_dict()[name]) for name, value in whole.state_dict().items())
    assert second.report() == whole.report()
    return everything
