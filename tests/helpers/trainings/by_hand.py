"""Layers of networks in float64, number by number."""

import numpy as np
import torch


def convolved(layer, x):
    """What a convolution over reflected borders makes of [C, H, W]."""
    weights, bias = layer.weight.detach().double(), layer.bias.detach().double()
    padded = torch.nn.functional.pad(torch.from_numpy(x).double(), [layer.padding[0]] * 4, mode="reflect")
    return torch.nn.functional.conv2d(padded, weights, bias, layer.stride, 0, layer.dilation).numpy()


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


def assert_same_values_and_gradients(ours, theirs, upstream, *inputs):
    """Two functions of tensors have the same values and, by the inputs, the same gradients."""
    ends = []
    for function in (ours, theirs):
        leaves = [values.clone().requires_grad_() for values in inputs]
        values = function(*leaves)
        ends.append((values, *torch.autograd.grad(values, leaves, upstream)))
    assert all(torch.allclose(found, expected, atol=1e-12) for found, expected in zip(*ends, strict=True))
