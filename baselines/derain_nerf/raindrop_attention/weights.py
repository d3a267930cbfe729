"""Trained generators on disk: safetensors with their configuration and data card."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.derain_nerf.raindrop_attention.config import GeneratorConfig
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.training.checkpoints import read_arrays, write_arrays
from baselines.training.network_commands import weights_file
from hydroviews.errors import InputError

SHIPPED = Path(__file__).parent / "weights"
DEFAULT = "small"


@dataclass(frozen=True, eq=False)
class Detector:
    """A trained generator, ready to use."""

    generator: DerainGenerator
    card: dict[str, Any]  # data, seed, steps, validation


def load_detector(weights: str | Path = DEFAULT) -> Detector:
    """The generator of the named shipped weights, or of a file.

    Args:
        weights: `small`, or the path of a .safetensors file that
            `python -m baselines.derain_nerf.raindrop_attention train` wrote.

    Raises:
        InputError: no such weights, or the file is damaged or holds another network.
    """
    path = find_weights(weights)
    arrays, about = read_arrays(path)
    return Detector(_build(path, about, arrays), about["card"])


def find_weights(weights: str | Path) -> Path:
    """The file of the named shipped weights, or the file itself.

    Raises:
        InputError: no weights of that name are shipped.
    """
    return weights_file(weights, SHIPPED, "raindrop attention")


def save_generator(path: Path, config: GeneratorConfig, tensors: dict[str, Tensor], card: dict[str, Any]) -> None:
    """Write weights, as half floats, with what is needed to use and to judge them."""
    arrays = {name: value.detach().half().numpy() for name, value in tensors.items()}
    write_arrays(path, arrays, {"generator": asdict(config), "card": card})


def _build(path: Path, about: dict[str, Any], arrays: dict[str, NDArray]) -> DerainGenerator:
    try:
        generator = DerainGenerator(GeneratorConfig(**about["generator"]))
        generator.load_state_dict({name: torch.from_numpy(value) for name, value in arrays.items()})
    except (KeyError, TypeError, RuntimeError) as error:
        raise InputError(f"{path}: not a raindrop attention network of this version", found=error) from error
    return generator.eval().requires_grad_(False).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
