# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""What 3DGS-MCMC adds to a step (Kheradmand et al. 2024): penalties before it, noise after it.

    loss += by_opacity sum_i o_i + by_scale sum_ik s_ik              o = sigmoid(logit), s = exp(log scale)
    mean_i += factor sigmoid(k ((1 - o_i) - t)) Sigma_i n_i          Sigma = R S S R^T, n ~ N(0, 1) (equation 8)

Penalties make superfluous Gaussians die, noise lets those that are nearly transparent explore.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import exact_kernel
from baselines.splatting.kernels.splats.geometry import exp64, rotation, sigmoid, unit_quaternion

GATE_STEEPNESS, GATE = 100.0, 0.995  # k and t: noise for a transparency above t, so for opacities below 0.005
FARTHEST = 1e30  # a move of this length is that of a non-finite Gaussian, which stays as it is
CHUNKS = 32


@exact_kernel
def penalty_gradients(log_scales, opacity_logits, by_scale, by_opacity, g_log_scales, g_opacity_logits):
    """Add the gradients of both penalties, in place: `by_scale` sum(exp(log_scales)), `by_opacity` sum(opacity)."""
    n = opacity_logits.shape[0]
    for chunk in prange(CHUNKS):
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            opacity = sigmoid(np.float64(opacity_logits[i]))
            g_opacity_logits[i] += by_opacity * opacity * (1 - opacity)
            for k in range(3):
                g_log_scales[i, k] += by_scale * exp64(np.float64(log_scales[i, k]))


@exact_kernel
def move_by_noise(means, quaternions, log_scales, opacity_logits, normal, factor):
    """Move `means` [N, 3] in place by the gated noise made of `normal` [N, 3]; `factor` is in 1 / world units."""
    n = means.shape[0]
    for chunk in prange(CHUNKS):
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            transparency = 1 - sigmoid(np.float64(opacity_logits[i]))
            weight = factor * sigmoid(GATE_STEEPNESS * (transparency - GATE))
            qw, qx = np.float64(quaternions[i, 0]), np.float64(quaternions[i, 1])
            qy, qz = np.float64(quaternions[i, 2]), np.float64(quaternions[i, 3])
            qw, qx, qy, qz, _ = unit_quaternion(qw, qx, qy, qz)
            r = rotation(qw, qx, qy, qz)
            n0, n1, n2 = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
            v0 = exp64(2 * np.float64(log_scales[i, 0])) * (r[0] * n0 + r[3] * n1 + r[6] * n2)
            v1 = exp64(2 * np.float64(log_scales[i, 1])) * (r[1] * n0 + r[4] * n1 + r[7] * n2)
            v2 = exp64(2 * np.float64(log_scales[i, 2])) * (r[2] * n0 + r[5] * n1 + r[8] * n2)
            if not weight * (abs(v0) + abs(v1) + abs(v2)) < FARTHEST:  # false for NaN
                continue
            means[i, 0] += weight * (r[0] * v0 + r[1] * v1 + r[2] * v2)
            means[i, 1] += weight * (r[3] * v0 + r[4] * v1 + r[5] * v2)
            means[i, 2] += weight * (r[6] * v0 + r[7] * v1 + r[8] * v2)
