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

from baselines.splatting.kernels.jit import inlined, kernel
from baselines.splatting.kernels.vector.memory import load, load_first, store, store_first
from baselines.splatting.kernels.vector.vectors import LANES, square_root

BETA1, BETA2 = 0.9, 0.999
EPSILON = 1e-15  # that of Kerbl et al. 2023
CHUNKS = 32
RATES = 1536  # learning rates are tiled to about this length, so that few vectors are parts


@inlined
def moved(value, gradient, first, second, rate, constants):
    """A parameter and its two moments after the step; numbers or vectors, float32. For constants see `settings`."""
    first = constants[0] * first + constants[1] * gradient
    second = constants[2] * second + constants[3] * gradient * gradient
    return value - rate * first / (square_root(second) * constants[4] + constants[5]), first, second


@inlined
def move(values, first, second, start, number, gradients, gradients_start, rates, constants):
    """One step of `number` parameters from `start` on, with rates[0:number]; flat arrays."""
    for part in range(0, number - LANES + 1, LANES):
        at = start + part
        gradient = load(gradients, gradients_start + part)
        p, m, v = load(values, at), load(first, at), load(second, at)
        p, m, v = moved(p, gradient, m, v, load(rates, part), constants)
        store(p, values, at)
        store(m, first, at)
        store(v, second, at)
    rest = number % LANES
    if rest > 0:
        at = start + number - rest
        gradient = load_first(rest, gradients, gradients_start + number - rest)
        p, m, v = load_first(rest, values, at), load_first(rest, first, at), load_first(rest, second, at)
        p, m, v = moved(p, gradient, m, v, load_first(rest, rates, number - rest), constants)
        store_first(rest, p, values, at)
        store_first(rest, m, first, at)
        store_first(rest, v, second, at)


@kernel
def update(values, gradients, first, second, rates, constants):
    """One step on flat arrays; `rates` repeats along them."""
    n, period = values.shape[0], rates.shape[0]
    periods = (n + period - 1) // period
    for chunk in prange(CHUNKS):
        for index in range(chunk * periods // CHUNKS, (chunk + 1) * periods // CHUNKS):
            start = index * period
            move(values, first, second, start, min(period, n - start), gradients, start, rates, constants)


def settings(step: int, rates: float | NDArray[np.float32], epsilon: float = EPSILON) -> tuple[NDArray, NDArray]:
    """Learning rates [...] over 1 - beta1^t, flat, and what else `moved` wants to know of step t, both float32."""
    row = np.asarray(rates, np.float32).ravel() / np.float32(1 - BETA1**step)
    correction = 1 / math.sqrt(1 - BETA2**step)
    return row, np.array([BETA1, 1 - BETA1, BETA2, 1 - BETA2, correction, epsilon], np.float32)


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
    row, constants = settings(step, rates, epsilon)
    flat = [a.reshape(-1) for a in (values, gradients, first, second)]
    update(*flat, np.tile(row, max(1, RATES // row.size)), constants)
