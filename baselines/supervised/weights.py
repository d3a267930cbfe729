"""Trained networks on disk: safetensors of half floats with their configuration and data card, and the card as JSON."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from baselines.training.checkpoints import read_arrays, write_arrays
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json

DEFAULT = "small"  # name of weights that are shipped for every kind of network

N = TypeVar("N", bound=nn.Module)


@dataclass(frozen=True)
class NetworkFiles(Generic[N]):
    """Trained networks of one kind: those that are shipped, by name, and others by their files."""

    kind: str  # such as "enhancement", for messages
    shipped: Path  # folder of those that are shipped
    part: str  # name of the network's configuration in a file
    build: Callable[[dict[str, Any]], N]  # the network of such a configuration; lists are tuples again

    def find(self, weights: str | Path) -> Path:
        """The file of the named shipped weights, or the file itself.

        Raises:
            InputError: no weights of that name are shipped.
        """
        if Path(weights).suffix:
            return Path(weights)
        path = self.shipped / f"{weights}.safetensors"
        if not path.is_file():
            names = ", ".join(sorted(file.stem for file in self.shipped.glob("*.safetensors")))
            raise InputError(
                f"{self.kind} weights {weights}: none of that name are shipped",
                expected=f"one of: {names or 'none'}; or the path of a .safetensors file",
            )
        return path

    def load(self, weights: str | Path) -> tuple[N, dict[str, Any]]:
        """The network of the named shipped weights, or of a file, ready to use, and its data card.

        Raises:
            InputError: no such weights, or the file is damaged or holds another network.
        """
        path = self.find(weights)
        arrays, about = read_arrays(path)
        try:
            config = {name: tuple(v) if isinstance(v, list) else v for name, v in about[self.part].items()}
            network = self.build(config)
            network.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})
            card: dict[str, Any] = about["card"]
        except (KeyError, TypeError, RuntimeError) as error:
            raise InputError(f"{path}: no {self.kind} network of this version", found=error) from error
        return network.eval().requires_grad_(False), card

    def save(self, path: Path, network: nn.Module, card: Mapping[str, Any]) -> None:
        """Write a network as half floats, with what is needed to use and to judge it, and its card beside it.

        Args:
            path: the .safetensors file; the card's has the same name and ends in .json.
            network: has its configuration, a dataclass, as `config`.
            card: what it was trained on and how well it does, for JSON.
        """
        about = {self.part: asdict(network.config)}  # type: ignore[call-overload]
        arrays = {name: value.detach().cpu().half().numpy() for name, value in network.state_dict().items()}
        write_arrays(path, arrays, {**about, "card": card})
        write_json(path.with_suffix(".json"), {**about, **card})


def rounded(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights as they come back from a file of half floats."""
    return {name: value.half().float() for name, value in tensors.items()}
