"""Trained networks on disk: safetensors with their configuration and data card."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.training.checkpoints import read_arrays, write_arrays
from baselines.training.devices import chosen_device
from baselines.training.network_commands import weights_file
from deraings.enhancement.architecture.network import EnhancementNetwork, NetworkConfig
from hydroviews.errors import InputError

SHIPPED = Path(__file__).parent / "weights"
DEFAULT = "small"


@dataclass(frozen=True, eq=False)
class Enhancer:
    """A trained network, ready to use."""

    network: EnhancementNetwork
    card: dict[str, Any]  # data, seed, steps, validation
    reason: str  # which weights these are and why


def load_enhancer(weights: str | Path = DEFAULT, device: str = "auto") -> Enhancer:
    """The network of the named shipped weights, or of a file.

    Args:
        weights: `small`, or the path of a .safetensors file that `python -m deraings.enhancement train` wrote.
        device: where it is to calculate, see `chosen_device`.

    Raises:
        InputError: no such weights, the file is damaged or holds another network, or there is no such device.
    """
    path = find_weights(weights)
    arrays, about = read_arrays(path)
    network = build(path, about, arrays).to(chosen_device(device))
    torch.backends.cudnn.allow_tf32 = False  # a GPU's pictures are the CPU's; 10 bits of mantissa would be seen in them
    origin = f"shipped as {weights}" if path.parent == SHIPPED else f"from {path}, as asked for"
    card = about["card"]
    return Enhancer(network, card, f"enhancement weights {origin}: {card['steps']} steps on {card['data']}")


def find_weights(weights: str | Path) -> Path:
    """The file of the named shipped weights, or the file itself.

    Raises:
        InputError: no weights of that name are shipped.
    """
    return weights_file(weights, SHIPPED, "enhancement")


def save_network(path: Path, config: NetworkConfig, tensors: dict[str, Tensor], card: dict[str, Any]) -> None:
    """Write weights, as half floats, with what is needed to use and to judge them."""
    write_arrays(
        path,
        to_arrays({name: value.half() for name, value in tensors.items()}),
        {"network": asdict(config), "card": card},
    )


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


def build(path: Path, about: dict[str, Any], arrays: dict[str, NDArray]) -> EnhancementNetwork:
    """The network that weights are of, ready for pictures.

    Raises:
        InputError: they are not of such a network.
    """
    try:
        parts: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in about["network"].items()}
        network = EnhancementNetwork(NetworkConfig(**parts))
        network.load_state_dict(to_tensors(arrays))
    except (KeyError, TypeError, RuntimeError) as error:
        raise InputError(f"{path}: not an enhancement network of this version", found=error) from error
    return network.eval().requires_grad_(False)


def to_arrays(tensors: dict[str, Tensor]) -> dict[str, NDArray]:
    """Weights as arrays for safetensors, which wants them contiguous."""
    return {name: np.ascontiguousarray(value.detach().cpu().numpy()) for name, value in tensors.items()}


def to_tensors(arrays: dict[str, NDArray]) -> dict[str, Tensor]:
    """Arrays of a weights file as tensors; the inverse of `to_arrays`."""
    return {name: torch.from_numpy(value) for name, value in arrays.items()}
