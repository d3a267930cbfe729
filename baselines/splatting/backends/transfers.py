"""Arrays between the CPU and the GPU, without waiting longer than needed."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

SMALL = 1 << 16  # bytes of an array that pinned memory does not pay for


def sent(values: NDArray[np.float32]) -> Tensor:
    """An array, uploaded without waiting for what the GPU does; it may be written over at once."""
    if values.nbytes <= SMALL:  # the driver takes a copy of it first
        return torch.from_numpy(values).cuda(non_blocking=True)
    return _pinned(values.shape).copy_(torch.from_numpy(values)).cuda(non_blocking=True)


def fetched(values: Tensor) -> NDArray[np.float32]:
    """An array of the GPU's, downloaded."""
    return _pinned(values.shape).copy_(values.detach()).numpy()


def _pinned(shape: Sequence[int]) -> Tensor:
    """Memory of the CPU that the GPU reads and writes itself: copies take a fourth to two fifths of the time.

    Torch keeps it for the next that ask, and does not hand it out while a copy is under way.
    """
    return torch.empty(shape, pin_memory=True)
