"""What the enhancement network is trained to make small."""

import torch
from torch import Tensor
from torch.nn import functional

SQUARE = 16  # pixels along a side of the squares whose mean errors count
SMOOTH = 1.0  # weight of these means beside the error of pixels
FLOOR = 0.1  # added to the mean absolute error by rain that a picture's loss is a share of
OVERLAP = 0.3  # weight of the cover's overlap beside its cross entropy
FEW = 50.0  # pixels, covered where nothing is, so that a false one does not cost all of the overlap


def enhancement_loss(
    enhanced: Tensor, clean: Tensor, rainy: Tensor, frequency: float, smooth: float = SMOOTH, floor: float = FLOOR
) -> Tensor:
    """Absolute error of pixels, of squares and of Fourier coefficients, as a share of what rain did to each picture.

    The coefficients (Cho et al. 2021, MIMO-UNet) are scaled so that white noise has as large an error in them as in
    pixels. An oriented error, such as streaks, is large in many of them. A smooth one, such as mist, is concentrated
    in so few that their mean hardly notices; the squares' means are for that. The share makes thin rain count more
    like thick rain, as a gain in dB does; without it what is learned is mostly thick mist, and with a floor of 0.02
    that any change is dangerous.

    Args:
        enhanced: [N, 3, H, W].
        clean: the same shape.
        rainy: the same shape.
        frequency: weight of the coefficients.
        smooth: weight of the squares.
        floor: added to a rainy picture's mean absolute error, so that thin rain does not count without bounds.

    Returns:
        A scalar.
    """
    error = enhanced - clean
    size = error.abs().mean(dim=(1, 2, 3))
    if frequency > 0:
        size = size + frequency * torch.fft.rfft2(error, norm="ortho").abs().mean(dim=(1, 2, 3))
    if smooth > 0:
        size = size + smooth * functional.avg_pool2d(error, SQUARE, ceil_mode=True).abs().mean(dim=(1, 2, 3))
    rain = (rainy - clean).abs().mean(dim=(1, 2, 3))
    return (size / (rain + floor)).mean()


def error_loss(scale: Tensor, enhanced: Tensor, clean: Tensor) -> Tensor:
    """Negative log likelihood of errors as of a Laplace distribution: |error| / s + log s, the least at s = E |error|.

    Args:
        scale: s, predicted, [N, 1, H, W], positive.
        enhanced: [N, 3, H, W].
        clean: the same shape.

    Returns:
        A scalar.
    """
    error = (enhanced - clean).abs().mean(dim=1, keepdim=True)
    return (error / scale + scale.log()).mean()


def cover_loss(logits: Tensor, cover: Tensor) -> Tensor:
    """Cross entropy and overlap of the cover by streaks, drops and mist, which the generator has drawn.

    Drops cover a few per cent of the pixels, which cross entropy alone hardly notices. Overlap is Dice's coefficient
    of squares (Milletari et al. 2016), of each picture's streaks and drops.

    Args:
        logits: [N, 3, H, W].
        cover: the same shape, [0, 1]; NaN where nobody knows, which does not count.

    Returns:
        A scalar; 0 where nothing is known.
    """
    known, true = ~cover.isnan(), cover.nan_to_num()
    every = functional.binary_cross_entropy_with_logits(logits, true, reduction="none")
    entropy = (every * known).sum() / known.sum().clamp_min(1)
    found = torch.sigmoid(logits) * known
    shared, of_true = ((plane * true).sum((2, 3)) for plane in (found, true))
    apart = 1 - (2 * shared + FEW) / ((found * found).sum((2, 3)) + of_true + FEW)
    return entropy + OVERLAP * (apart[:, :2] * known.any((2, 3))[:, :2]).mean()
