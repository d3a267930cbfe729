"""How a network is trained: as data, so that a checkpoint and a data card can say it."""

from dataclasses import dataclass
from typing import Literal

from baselines.training.numbers import require_numbers
from deraings.enhancement.architecture.network import SMALL, NetworkConfig

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class TrainingConfig:
    """Settings of a training, other than its data, that change the weights."""

    network: NetworkConfig = SMALL
    steps: int = 5_000
    batch: int = 4
    patch: int = 192  # pixels along a side; at most the shorter side of a photograph's smaller frame
    rate: float = 1e-3  # learning rate of AdamW (Loshchilov and Hutter 2019) after the warm-up
    final_rate: float = 1e-6  # learning rate at the end of the cosine
    warm_up: int = 200  # steps in which the rate rises linearly
    weight_decay: float = 1e-4
    clip: float = 2.0  # largest norm of a step's gradient
    frequency: float = 3.0  # weight of the loss in Fourier coefficients
    smooth: float = 1.0  # weight of the loss in means of squares
    floor: float = 0.1  # added to the mean absolute error by rain that a picture's loss is a share of
    lifting: float = 0.5  # weight of the mist's own loss, if the network has a mist branch
    detection: float = 0.5  # weight of the loss of the cover, if the network predicts it
    doubt: float = 0.1  # weight of the loss of the predicted error, if the network predicts it
    averaging: float = 0.999  # decay of the moving average of the weights per step
    # Of convolutions and attention in training; weights are float32 in both. A GPU is faster in bfloat16. A processor
    # without AMX takes twice as long in it.
    precision: Precision = "float32"
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self)
