"""Trained generators on disk."""

from pathlib import Path
from typing import Any

import torch

from baselines.derain_nerf.raindrop_attention.config import GeneratorConfig
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.supervised.weights import DEFAULT, NetworkFiles


def _build(config: dict[str, Any]) -> DerainGenerator:
    return DerainGenerator(GeneratorConfig(**config)).to(memory_format=torch.channels_last)  # type: ignore[call-overload]


FILES = NetworkFiles("raindrop attention", Path(__file__).parent / "weights", "generator", _build)
find_weights = FILES.find


def load_detector(weights: str | Path = DEFAULT) -> DerainGenerator:
    """The generator of the named shipped weights, or of a file, ready to use.

    Args:
        weights: `small`, or the path of a .safetensors file that
            `python -m baselines.derain_nerf.raindrop_attention train` wrote.

    Raises:
        InputError: no such weights, or the file is damaged or holds another network.
    """
    return FILES.load(weights)[0]
