"""How large a network is: parameters, and multiply-adds for a picture, by part."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from deraings.enhancement.enhance import refine_padded
from deraings.enhancement.network import EnhancementNetwork, NetworkConfig, TransposedAttention


@dataclass
class Part:
    """One of the network's parts."""

    parameters: int
    operations: int = 0  # multiply-adds


def measure(config: NetworkConfig, width: int, height: int) -> dict[str, Part]:
    """Parameters and multiply-adds of every part for one picture, nothing being computed.

    Convolutions, and the two products of attention; what is done once a pixel and channel is left out, as usual.
    """
    with torch.device("meta"):
        network = EnhancementNetwork(config)
        picture = torch.zeros(1, 3, height, width)
        parts = {name: Part(sum(p.numel() for p in child.parameters())) for name, child in network.named_children()}
        for name, module in network.named_modules():
            if isinstance(module, nn.Conv2d | TransposedAttention):
                module.register_forward_hook(_count_into(parts[name.split(".")[0]]))
        refine_padded(network, network.remove_mist(picture))
    return parts


def _count_into(part: Part) -> Callable[[nn.Module, tuple[Tensor, ...], Tensor], None]:
    def count(module: nn.Module, inputs: tuple[Tensor, ...], output: Tensor) -> None:
        pixels = output.shape[-2] * output.shape[-1]
        if isinstance(module, nn.Conv2d):
            part.operations += pixels * module.weight.numel()
        elif isinstance(module, TransposedAttention):
            part.operations += 2 * pixels * output.shape[1] ** 2 // module.heads

    return count


def describe(config: NetworkConfig, width: int, height: int) -> str:
    """The same as a table."""
    parts = measure(config, width, height)
    lines = [f"{'part':<12}{'parameters':>14}{'multiply-adds':>18}   a picture of {width}x{height}"]
    lines += [f"{name:<12}{part.parameters:>14,}{part.operations:>18,}" for name, part in parts.items()]
    total = sum(part.parameters for part in parts.values()), sum(part.operations for part in parts.values())
    return "\n".join([*lines, f"{'all':<12}{total[0]:>14,}{total[1]:>18,}"])
