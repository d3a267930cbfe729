import numpy as np

from baselines.splatting.kernels.buffer_pool import BufferPool


def test_a_buffer_has_the_type_that_is_asked_for():
    buffers = BufferPool()
    numbers = buffers.array("values", (4, 3))
    numbers[:] = 1.5
    indices = buffers.array("values", (3, 4), np.int32)
    assert (numbers.dtype, indices.dtype) == (np.float32, np.int32)
    indices[:] = 7
    assert (numbers == 1.5).all()


def test_a_buffer_is_kept_and_grows():
    buffers = BufferPool()
    first = buffers.array("values", (100,))
    assert np.shares_memory(first, buffers.array("values", (10, 10)))
    assert np.shares_memory(first, buffers.array("values", (125,)))  # made a quarter larger than asked for
    assert not np.shares_memory(first, buffers.array("values", (126,)))
    assert not np.shares_memory(buffers.array("values", (5,)), buffers.array("others", (5,)))
