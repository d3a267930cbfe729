"""Rotations as quaternions (w, x, y, z): one formula, for numbers, numpy arrays and torch tensors alike.

    R = [[1 - 2 (y^2 + z^2),  2 (x y - w z),      2 (x z + w y)    ],
         [2 (x y + w z),      1 - 2 (x^2 + z^2),  2 (y z - w x)    ],
         [2 (x z - w y),      2 (y z + w x),      1 - 2 (x^2 + y^2)]]        for w^2 + x^2 + y^2 + z^2 = 1

The splatting kernels have the same formula, compiled; a test compares them.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

SHORTEST = 1e-12  # a quaternion shorter than this is no rotation


def rotation_entries(w: Any, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """The nine entries of R, row by row, of a unit quaternion; its parts may be arrays or tensors of one shape."""
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


def rotation_matrices(quaternions: NDArray) -> NDArray[np.float64]:
    """Matrices [N, 3, 3] of quaternions [N, 4] of any length."""
    q = quaternions.astype(np.float64)
    unit = q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), SHORTEST)
    return np.stack(rotation_entries(*unit.T), axis=1).reshape(-1, 3, 3)
