"""What the enhancement network is trained to make small."""

import torch
from torch import Tensor


def enhancement_loss(enhanced: Tensor, clean: Tensor, rainy: Tensor, frequency: float, floor: float) -> Tensor:
    """Absolute error of pictures and of their Fourier coefficients, as a share of what rain did to each picture.

    The coefficients (Cho et al. 2021, MIMO-UNet) are scaled so that white noise has as large an error in them as in
    pixels; what is smooth, such as a veil, or oriented, such as streaks, is concentrated in few of them. The share
    makes thin rain count like thick rain, as a gain in dB does; without it what is learned is mostly thick mist.

    Args:
        enhanced: [N, 3, H, W].
        clean: the same shape.
        rainy: the same shape.
        frequency: weight of the coefficients.
        floor: mean absolute error of a rainy picture below which it counts no more: a clean one has none.

    Returns:
        A scalar, about 1 + `frequency` where nothing is enhanced.
    """
    error = enhanced - clean
    size = error.abs().mean(dim=(1, 2, 3))
    if frequency > 0:
        size = size + frequency * torch.fft.rfft2(error, norm="ortho").abs().mean(dim=(1, 2, 3))
    rain = (rainy - clean).abs().mean(dim=(1, 2, 3))
    return (size / (rain + floor)).mean()
