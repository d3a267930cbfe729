"""Encodings of positions and directions: what networks are given instead."""

import math

import torch
from torch import Tensor

from baselines.splatting.backends.torch_rasterizer import basis

HARMONICS = 16  # up to degree 3


def positional(values: Tensor, octaves: int) -> Tensor:
    """The values [..., C] and sines and cosines of 2^k pi times them, octave after octave: [..., C (1 + 2 octaves)].

    Mildenhall et al. 2020, equation 4.
    """
    frequencies = math.pi * 2.0 ** torch.arange(octaves, device=values.device, dtype=values.dtype)
    scaled = (values[..., None, :] * frequencies[:, None]).flatten(-2)
    return torch.cat([values, scaled.sin(), scaled.cos()], -1)


def harmonics(directions: Tensor) -> Tensor:
    """Spherical harmonics [R, HARMONICS] of unit vectors [R, 3]."""
    return basis(3, directions)


def linear(inputs: int, outputs: int, generator: torch.Generator, bias: bool = True) -> torch.nn.Linear:
    """A layer whose start is drawn from the generator (He et al. 2015, uniform); biases start at zero."""
    layer = torch.nn.Linear(inputs, outputs, bias=bias)
    bound = math.sqrt(6 / inputs)
    with torch.no_grad():
        layer.weight.uniform_(-bound, bound, generator=generator)
        if bias:
            layer.bias.zero_()
    return layer
