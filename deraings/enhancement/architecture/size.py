"""How large a network is: parameters, and multiply-adds for a picture, by part."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from deraings.enhancement.architecture.lens_statistics import halved, lens_statistics
from deraings.enhancement.architecture.network import EnhancementNetwork, NetworkConfig
from deraings.enhancement.enhance import padded


@dataclass
class Part:
    """One of the network's parts."""

    parameters: int
    operations: int = 0  # multiply-adds


def measure(config: NetworkConfig, width: int, height: int) -> dict[str, Part]:
    """Parameters and multiply-adds of every part for one picture, nothing being computed.

    Convolutions and products of matrices, as torch counts them; what is done once a pixel and channel is left out, as
    usual.
    """
    with torch.device("meta"), torch.no_grad():
        whole = _Whole(EnhancementNetwork(config))
        with FlopCounterMode(display=False) as counter:
            whole(torch.zeros(1, 3, height, width))
    counts = counter.get_flop_counts()
    return {
        name: Part(
            sum(parameter.numel() for parameter in part.parameters()),
            _operations(counts, f"{_Whole.__name__}.network.{name}", part) // 2,  # two make a multiply-add
        )
        for name, part in whole.network.named_children()
    }


class _Whole(nn.Module):
    """All that is done to a picture as one module, so that what is counted has the names of the network's parts."""

    def __init__(self, network: EnhancementNetwork):
        super().__init__()
        self.network = network

    def forward(self, picture: Tensor) -> Tensor:
        if not self.network.config.lens:
            return padded(self.network.refine, self.network.multiple, self.network.remove_mist(picture))
        lens = lens_statistics(halved(picture))
        free = self.network.remove_mist(picture, lens.coarse[None])
        return padded(self.network.refine, self.network.multiple, free, lens.fine[None])


def _operations(counts: Mapping[str, Mapping[Any, int]], name: str, module: nn.Module) -> int:
    """Of a module by its name, or of its children where it is a mere list, which is never called."""
    if name in counts:
        return sum(counts[name].values())
    return sum(_operations(counts, f"{name}.{child}", part) for child, part in module.named_children())


def describe(config: NetworkConfig, width: int, height: int) -> str:
    """The same as a table."""
    parts = measure(config, width, height)
    lines = [f"{'part':<12}{'parameters':>14}{'multiply-adds':>18}   a picture of {width}x{height}"]
    lines += [f"{name:<12}{part.parameters:>14,}{part.operations:>18,}" for name, part in parts.items()]
    total = sum(part.parameters for part in parts.values()), sum(part.operations for part in parts.values())
    return "\n".join([*lines, f"{'all':<12}{total[0]:>14,}{total[1]:>18,}"])
