"""How a network is trained from pairs: as data, so that a checkpoint and a data card can say it."""

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

from hydroviews.errors import InputError

Precision = Literal["float32", "bfloat16"]
COUNTS = ("steps", "batch", "patch", "crops", "removal_every", "validate_every")


def require_numbers(settings: Any) -> None:
    """Refuse numbers that no training can have; for `__post_init__` of a dataclass of settings.

    Raises:
        InputError: a number is negative or not finite, or one that counts is less than 1.
    """
    for field in fields(settings):
        value, least = getattr(settings, field.name), 1 if field.name in COUNTS else 0
        if isinstance(value, int | float) and not (math.isfinite(value) and value >= least):
            option = field.name.replace("_", "-")
            raise InputError(f"--{option} {value}: impossible", expected=f"a number of at least {least}")


@dataclass(frozen=True, kw_only=True)
class SupervisedConfig:
    """Settings of a training, other than its data, that change the weights; a network adds its own."""

    steps: int = 5_000
    batch: int = 4  # pictures a step
    patch: int = 192  # pixels along a side; at most the shorter side of a photograph's smaller frame
    rate: float = 1e-3  # learning rate of Adam after the warm-up; half a cosine takes it to next to nothing
    warm_up: int = 200  # steps in which the rate rises linearly
    averaging: float = 0.999  # decay of the moving average of the weights per step
    # Precision of convolutions and attention in training; weights are float32 in both. GPUs, and processors with AMX or
    # AVX512-BF16 (AMD Zen 4: 1.33 s a step in place of 1.75), are faster in bfloat16; others take twice as long in it.
    precision: Precision = "float32"
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self)


@dataclass(frozen=True)
class Intervals:
    """Intervals of checkpoints and validations; they do not change the weights."""

    checkpoint_seconds: float = 30.0  # seconds between two checkpoints; 0: one after every step
    validate_every: int = 500  # steps between two validations

    def __post_init__(self) -> None:
        require_numbers(self)
