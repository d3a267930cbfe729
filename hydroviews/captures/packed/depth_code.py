"""Depth maps in few bytes and without loss: residuals of a prediction, compressed.

On a plane 1 / depth is linear in the pixel. The prediction is left + above - above left, of the neighbours' 1 / depth.
The residual is the difference of two float32 numbers' bit patterns, a few units on planes. All arithmetic is float64
division and addition, which every processor rounds in the same way.
"""

import lzma

import numpy as np
from numpy.typing import NDArray

Maps = NDArray[np.float32]  # [N, H, W]


def encode(depth: Maps) -> bytes:
    """Compressed depth maps [N, H, W] of any float32 values; `inf` is sky."""
    known = _padded(depth.shape)
    known[:, 1:, 1:] = _inverse(depth)
    predicted = _depth(known[:, 1:, :-1] + known[:, :-1, 1:] - known[:, :-1, :-1])
    difference = (_bits(np.ascontiguousarray(depth, np.float32)) - _bits(predicted)).view(np.int32)
    folded = (difference << 1) ^ (difference >> 31)  # small numbers of either sign become small ones
    return lzma.compress(folded.view(np.uint8).reshape(-1, 4).T.tobytes(), preset=9)


def decode(code: bytes, shape: tuple[int, int, int]) -> Maps:
    """The depth maps of that shape that `encode` was given, bit by bit.

    Raises:
        ValueError: the code is of another shape.
        lzma.LZMAError: the code is damaged.
    """
    bytes_of = np.frombuffer(lzma.decompress(code), np.uint8).reshape(4, -1)
    folded = np.ascontiguousarray(bytes_of.T).view(np.uint32).reshape(shape)
    difference = (folded >> 1) ^ (0 - (folded & 1))
    depth, known = np.empty(shape, np.float32), _padded(shape)
    height, width = shape[1:]
    for diagonal in range(height + width - 1):  # its pixels need those of earlier diagonals alone
        row = np.arange(max(0, diagonal - width + 1), min(height, diagonal + 1))
        column = diagonal - row
        predicted = _depth(known[:, row + 1, column] + known[:, row, column + 1] - known[:, row, column])
        depth[:, row, column] = (_bits(predicted) + difference[:, row, column]).view(np.float32)
        known[:, row + 1, column + 1] = _inverse(depth[:, row, column])
    return depth


def _padded(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros for 1 / depth of maps of a shape, with a row above and a column on the left."""
    return np.zeros((shape[0], shape[1] + 1, shape[2] + 1))


def _inverse(depth: Maps) -> NDArray[np.float64]:
    """1 / depth; 0 where nothing is in front of the camera."""
    positive = np.isfinite(depth) & (depth > 0)
    return np.divide(1, depth, where=positive, out=np.zeros(depth.shape), dtype=np.float64)


def _depth(inverse: NDArray[np.float64]) -> Maps:
    far = np.full(inverse.shape, np.inf)
    return np.divide(1, inverse, where=inverse > 1e-9, out=far).astype(np.float32)


def _bits(depth: Maps) -> NDArray[np.uint32]:
    return depth.view(np.uint32)
