# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""How fast the loss falls as a Gaussian moves on the image, summed up over views for adaptive density control.

    gradient_sum_i += |(W / 2, H / 2) * dloss/d(x_i, y_i)|,    seen_i += 1        for every Gaussian i that a view shows

with (x_i, y_i) in pixels of a W x H image: gradients are by the position in units of half the image (Kerbl et al. 2023,
section 5.2). The mean, gradient_sum / seen, is what `strategies/densification.py` compares with its threshold.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import kernel

CHUNKS = 16


@kernel
def add_position_gradients(visible, means2d, half_width, half_height, gradient_sum, seen):
    """Add one view's to `gradient_sum` and `seen` [N]; `visible` [N] says which Gaussians the view shows."""
    n = visible.shape[0]
    for chunk in prange(CHUNKS):
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            if visible[i]:
                x, y = means2d[i, 0] * half_width, means2d[i, 1] * half_height
                gradient_sum[i] += np.sqrt(x * x + y * y)
                seen[i] += np.float32(1)
