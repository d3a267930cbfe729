"""Layers of networks in float64, number by number."""

import numpy as np
import torch


def convolved(layer, x):
    """What a convolution over reflected borders makes of [C, H, W]."""
    weights, bias = layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy()
    side, stride, pad, apart = weights.shape[-1], layer.stride[0], layer.padding[0], layer.dilation[0]
    padded = np.pad(x, ((0, 0), (pad, pad), (pad, pad)), mode="reflect")
    reach = apart * (side - 1) + 1
    rows = range(0, padded.shape[1] - reach + 1, stride)
    columns = range(0, padded.shape[2] - reach + 1, stride)
    parts = [
        [(weights * padded[:, r : r + reach : apart, c : c + reach : apart]).sum((1, 2, 3)) for c in columns]
        for r in rows
    ]
    return np.array(parts).transpose(2, 0, 1) + bias[:, None, None]


def applied(layer, x):
    """What a linear layer makes of [..., C]."""
    return x @ layer.weight.detach().double().numpy().T + layer.bias.detach().double().numpy()


def leaky(x, slope):
    """LeakyReLU."""
    return np.where(x > 0, x, slope * x)


def shaken(network, size=0.2):
    """The network, its parameters moved by some noise, so that no start at zero hides a term."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(size * torch.randn(parameter.shape, generator=generator))
    return network
