"""The unreduced photometric loss: what each pixel adds to it, for masks to learn from.

    l = mean over channels of (1 - lambda) |C^ - C| + lambda (1 - SSIM)

The same kernel as the loss itself: windows of SSIM leave hidden pixels out.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import NONE, Target, compare
from hydroviews.scene.images import Image


def loss_map(
    image: Image, target: Target, lambda_dssim: float = 0.2, buffers: BufferPool | None = None
) -> NDArray[np.float32]:
    """(1 - lambda) |C^ - C| + lambda (1 - SSIM) of every pixel [H, W], averaged over channels; 0 where hidden.

    Its mean is what `photometric_loss` returns.

    Args:
        image: rendered, float32 [H, W, 3].
        target: what it should look like.
        lambda_dssim: lambda.
        buffers: memory to reuse; the map is one of them.

    Raises:
        ValueError: image and target differ in size.
    """
    losses = (buffers or BufferPool()).array("loss_map", image.shape[:2])
    compare(image, target, lambda_dssim, NONE, losses, NONE)
    return losses
