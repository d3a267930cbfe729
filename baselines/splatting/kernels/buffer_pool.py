"""Memory that a training loop uses again and again."""

import numpy as np
from numpy.typing import DTypeLike, NDArray


class BufferPool:
    """Buffers by name that are kept between calls and only ever grow, so that a training loop allocates nothing."""

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray:
        """A contiguous array with undefined content; it is overwritten when the same name is asked for again."""
        size = int(np.prod(shape))
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < size:
            buffer = self._buffers[name] = np.empty(size + size // 4, dtype)
        return buffer[:size].reshape(shape)
