"""Weights for the ResNet-18 that looks at references: from a file that the user names, never fetched."""

import os
import pickle
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import nn

from baselines.encoders.config import EncoderConfig
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256

WEIGHTS = "HYDROVIEWS_RESNET18"
UNREADABLE = (SafetensorError, pickle.UnpicklingError, OSError, EOFError, ValueError, RuntimeError)
Config = TypeVar("Config", bound=EncoderConfig)


def with_named_weights(config: Config) -> Config:
    """The settings with the weights that $HYDROVIEWS_RESNET18 names, where it is set and they are of a ResNet-18.

    Raises:
        InputError: no such file.
    """
    named = os.environ.get(WEIGHTS)
    if config.backbone != "resnet18" or not named:
        return config
    if not Path(named).is_file():
        raise InputError(f"{named}: no such file", expected="weights of ResNet-18", fix=f"correct {WEIGHTS}")
    return replace(config, weights=named, weights_sha256=sha256(Path(named)))


def encoder_used(config: EncoderConfig, masked: float) -> str:
    """What a summary says of the encoder, and of the share of the pixels that it masks."""
    weights = Path(config.weights).name if config.weights else "from scratch"
    return f"encoder {config.backbone} {weights}, {masked:.1%} of the pixels masked"


def load_resnet(backbone: nn.Module, path: Path) -> None:
    """Take over ResNet-18 weights: a .safetensors or torch file with torchvision's names; its classifier is ignored.

    Raises:
        InputError: missing, damaged, or not a ResNet-18.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file", expected="weights of ResNet-18", fix="correct HYDROVIEWS_RESNET18")
    try:
        safe = path.suffix == ".safetensors"
        state = load_file(path) if safe else torch.load(path, map_location="cpu", weights_only=True)
        wanted = backbone.state_dict()
        backbone.load_state_dict({name: state[name] for name in wanted})
    except (*UNREADABLE, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not weights of ResNet-18", found=f"{type(error).__name__}: {error}") from error
