"""Small networks that are asked anew for every Gaussian in every step."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn


def layers(inputs: int, hidden: Sequence[int], outputs: int) -> nn.Sequential:
    """Linear layers with rectifiers between them."""
    parts: list[nn.Module] = []
    for a, b in pairwise((inputs, *hidden, outputs)):
        linear = nn.Linear(a, b)
        nn.init.xavier_uniform_(linear.weight)
        nn.init.zeros_(linear.bias)
        parts += [linear, nn.ReLU()]
    return nn.Sequential(*parts[:-1])


def linear_of_parts(linear: nn.Linear, *parts: Tensor | int) -> Tensor:
    """What a linear layer makes of parts side by side [n, outputs], without laying them so.

    Most of a step's time goes into these products and their gradients. On a CPU those of rows of odd length are half as
    fast; what has no gradient (positions, directions) and what is zero costs nothing of the others' time.

    Args:
        linear: the layer.
        parts: what it is given, [n, width] each; a number is the width of one that is zero everywhere.

    Raises:
        ValueError: the widths do not add up to the layer's inputs.
    """
    total: Tensor = linear.bias
    begin = 0
    for part in parts:
        end = begin + (part if isinstance(part, int) else part.shape[1])
        if not isinstance(part, int):
            total = torch.addmm(total, part, linear.weight[:, begin:end].T)
        begin = end
    if begin != linear.in_features:
        raise ValueError(f"parts of {begin} numbers for a layer of {linear.in_features}")
    return total
