"""Steps of an objective on renders that stay as they are, compared to the bit."""

import numpy as np

from baselines.splatting.kernels.buffer_pool import BufferPool


def steps(objective, images, first, last):
    """Losses and gradients of some steps."""
    buffers, out = BufferPool(), []
    for step in range(first, last):
        view = step % len(images)
        loss, gradient = objective(images[view], view, step, buffers)
        out.append((loss, gradient.copy()))
    return out


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
