"""The cut-offs of the renderer, those of Kerbl et al. 2023 but NEAR; kernels and the float64 reference share them."""

import math

LOW_PASS = 0.3  # added to the diagonal of every screen-space covariance, in pixels^2
MAX_ALPHA = 0.99  # what one Gaussian covers of a pixel at most
MIN_ALPHA = 1 / 255  # below this a Gaussian leaves a pixel untouched
# A pixel is finished before its transmittance would fall below this. Two layers of MAX_ALPHA leave 1e-4, or a little
# less in float32: the hair above makes all precisions stop there.
MIN_TRANSMITTANCE = 1.0001e-4
FRUSTUM_MARGIN = 0.15  # the projection is linearised no further outside the image than this share of its size
NEAR = 0.01  # Gaussians with nearer centres are left out, in world units; Kerbl et al. have 0.2
FAR = 1e10

LOG2_E = 1.4426950408889634
LOG2_MIN_ALPHA = math.log2(MIN_ALPHA)
CONIC_SCALE = 0.5 * LOG2_E  # exp(-x / 2) = 2^(-CONIC_SCALE x)
