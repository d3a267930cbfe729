"""Settings of networks that look at a reference picture and learn with the scene."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class EncoderConfig:
    """The network that looks at the reference, and when the Gaussians have anything of it."""

    backbone: Literal["resnet18", "small"] = "resnet18"  # encoder of the U-Net that reads the reference picture
    weights: str | None = None  # file of ResNet-18 weights; None: random weights
    weights_sha256: str | None = None  # SHA-256 of the file of the weights
    shrink: int = 1  # factor by which the reference is shrunk before encoding
    absent: float = 0.0  # share of the steps without features of the reference
    visible_from: float = 2500 / 70_000  # share of the iterations after which the mask weighs the loss; above 1: never
    lpips: float = 0.005  # weight of LPIPS (VGG) in the loss

    def __post_init__(self) -> None:
        if not 0 <= self.absent < 1:
            raise ValueError(f"absent {self.absent}: expected a share below 1")
        if self.shrink < 1:
            raise ValueError(f"shrink {self.shrink}: expected 1 or more")
