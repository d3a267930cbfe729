"""Memory that a training loop uses again and again."""

import math

import numpy as np
from numpy.typing import DTypeLike, NDArray

CACHE_LINE = 64  # bytes


def aligned_empty(size: int, dtype: DTypeLike = np.float32) -> NDArray:
    """A flat array with undefined content that begins with a cache line: vectors of 64 bytes lie in one then."""
    bytes_needed = size * np.dtype(dtype).itemsize
    memory = np.empty(bytes_needed + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    return memory[start : start + bytes_needed].view(dtype)


class BufferPool:
    """Buffers by name and type that are kept between calls and only ever grow: a training loop allocates nothing."""

    def __init__(self) -> None:
        self._buffers: dict[tuple[str, np.dtype], NDArray] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray:
        """A contiguous array with undefined content; asking for the same name and type again overwrites it."""
        size = math.prod(shape)
        key = name, np.dtype(dtype)
        buffer = self._buffers.get(key)
        if buffer is None or buffer.size < size:
            buffer = self._buffers[key] = aligned_empty(size + size // 4, dtype)
        return buffer[:size].reshape(shape)
