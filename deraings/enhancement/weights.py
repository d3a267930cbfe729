"""Trained enhancement networks: those that are shipped, those in files, and means of several."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from baselines.supervised.weights import DEFAULT, NetworkFiles
from baselines.training.devices import chosen_device
from deraings.enhancement.architecture.network import EnhancementNetwork, NetworkConfig
from hydroviews.errors import InputError

FILES = NetworkFiles(
    kind="enhancement",
    shipped=Path(__file__).parent / "weights",
    part="network",
    build=lambda config: EnhancementNetwork(NetworkConfig(**config)),
)
find_weights = FILES.find


@dataclass(frozen=True, eq=False)
class Enhancer:
    """A trained network, ready to use."""

    network: EnhancementNetwork
    card: dict[str, Any]  # data, seed, steps, validation
    reason: str  # in a line, which weights these are and why


def load_enhancer(weights: str | Path = DEFAULT, device: str = "auto") -> Enhancer:
    """The network of the named shipped weights, or of a file.

    Args:
        weights: `small`, or the path of a .safetensors file that `python -m deraings.enhancement train` wrote.
        device: where it is to calculate, see `chosen_device`.

    Raises:
        InputError: no such weights, the file is damaged or holds another network, or there is no such device.
    """
    path = FILES.find(weights)
    network, card = FILES.load(path)
    network = network.to(chosen_device(device))
    torch.backends.cudnn.allow_tf32 = False  # a GPU's pictures are the CPU's; 10 bits of mantissa would be seen in them
    origin = f"shipped as {weights}" if path.parent == FILES.shipped else f"from {path}, as asked for"
    return Enhancer(network, card, f"enhancement weights {origin}, trained in {card['steps']} steps")


def mean_network(enhancers: Sequence[Enhancer]) -> EnhancementNetwork:
    """The network whose weights are the mean of others' (Wortsman et al. 2022, model soups).

    Raises:
        InputError: the networks differ in configuration.
    """
    configs = {enhancer.network.config for enhancer in enhancers}
    if len(configs) != 1:
        raise InputError("weights to average", found=f"{len(configs)} kinds of networks", expected="one kind")
    network = EnhancementNetwork(configs.pop())
    states = [enhancer.network.state_dict() for enhancer in enhancers]
    network.load_state_dict({name: torch.stack([state[name] for state in states]).mean(0) for name in states[0]})
    return network.eval().requires_grad_(False)
