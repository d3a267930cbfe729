# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Adam (Kingma and Ba 2015, algorithm 1) on float32 arrays in place.

    m <- beta1 m + (1 - beta1) g,    v <- beta2 v + (1 - beta2) g^2
    p <- p - rate m' / (sqrt(v') + epsilon),    m' = m / (1 - beta1^t),    v' = v / (1 - beta2^t)

for parameters p with gradients g, in step t.
"""

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from baselines.splatting.kernels.jit import kernel

BETA1, BETA2 = 0.9, 0.999
EPSILON = 1e-15  # that of Kerbl et al. 2023
ONE = np.float32(1)
CHUNKS = 32
RATES = 1536  # learning rates are tiled to about this length, so that the inner loop is long enough to vectorise


@kernel
def update(values, gradients, first, second, rates, beta1, beta2, epsilon, correction):
    """One step on flat arrays; `rates` repeats along them. `correction` is 1 / sqrt(1 - beta2^t)."""
    period = rates.shape[0]
    periods = (values.shape[0] + period - 1) // period
    b1, b2, eps, c = np.float32(beta1), np.float32(beta2), np.float32(epsilon), np.float32(correction)
    for chunk in prange(CHUNKS):
        for index in range(chunk * periods // CHUNKS, (chunk + 1) * periods // CHUNKS):
            start, end = index * period, min((index + 1) * period, values.shape[0])
            p, g, m, v = values[start:end], gradients[start:end], first[start:end], second[start:end]
            for i in range(end - start):
                m[i] = b1 * m[i] + (ONE - b1) * g[i]
                v[i] = b2 * v[i] + (ONE - b2) * g[i] * g[i]
                p[i] -= rates[i] * m[i] / (np.sqrt(v[i]) * c + eps)


def adam_step(
    values: NDArray[np.float32],
    gradients: NDArray[np.float32],
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    step: int,
    rates: float | NDArray[np.float32],
    epsilon: float = EPSILON,
) -> None:
    """Update values and both moments in place.

    Args:
        values, gradients, first, second: contiguous arrays of one shape [N, ...].
        step: number of this step, from 1.
        rates: one learning rate, or one for each entry of a row [...].
        epsilon: added to the root of the second moment.
    """
    if values.size == 0:
        return
    row = np.asarray(rates, np.float32).ravel() / np.float32(1 - BETA1**step)
    tiled = np.tile(row, max(1, RATES // row.size))
    correction = 1 / math.sqrt(1 - BETA2**step)
    flat = [a.reshape(-1) for a in (values, gradients, first, second)]
    update(*flat, tiled, BETA1, BETA2, epsilon, correction)
