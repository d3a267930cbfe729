"""The U-Net that looks at the reference picture: feature maps and a visibility mask (GS-W).

Pictures are [1, 3, H, W] with values around zero, both sides multiples of `multiple`. There is no batch normalisation
in training: a batch is one picture, whose own statistics are the very appearance that is to be encoded. ResNet's
layers
keep the statistics of their weights; without weights these are 0 and 1.
"""

import math
import pickle
from itertools import pairwise
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn import functional

from hydroviews.errors import InputError

VISIBLE_AT_FIRST = 0.98  # the mask before the first step, everywhere
UNREADABLE = (SafetensorError, pickle.UnpicklingError, OSError, EOFError, ValueError, RuntimeError)
SMALL = (16, 32, 48, 64)  # channels of the small backbone at 1/2, 1/4, 1/8 and 1/16
RESNET = (64, 64, 128, 256, 512)  # of ResNet-18 at 1/2, 1/4, ... 1/32


class FrozenNorm(nn.Module):
    """Batch normalisation with given statistics; scale and shift are learned. Parameters are named as torch's are."""

    def __init__(self, channels: int, first: float = 1.0) -> None:
        super().__init__()
        self.weight, self.bias = nn.Parameter(torch.full((channels,), first)), nn.Parameter(torch.zeros(channels))
        self.running_mean: Tensor
        self.running_var: Tensor
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    def forward(self, x: Tensor) -> Tensor:
        """[N, C, H, W] to the same."""
        return functional.batch_norm(x, self.running_mean, self.running_var, self.weight, self.bias)


class BasicBlock(nn.Module):
    """Two 3x3 convolutions and a shortcut (He et al. 2016); begins as the shortcut alone."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.bn1 = FrozenNorm(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.bn2 = FrozenNorm(outputs, first=0.0)
        self.downsample: nn.Module | None = None
        if stride > 1:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), FrozenNorm(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """[N, inputs, H, W] to [N, outputs, H / stride, W / stride]."""
        shortcut = x if self.downsample is None else self.downsample(x)
        return (self.bn2(self.conv2(self.bn1(self.conv1(x)).relu())) + shortcut).relu()


class ResNet18(nn.Module):
    """ResNet-18 (He et al. 2016) without its classifier; weights of torchvision's fit by name."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
        self.bn1 = FrozenNorm(64)
        strides = (1, 2, 2, 2)
        for number, ((inputs, outputs), stride) in enumerate(zip(pairwise(RESNET), strides, strict=True), 1):
            blocks = BasicBlock(inputs, outputs, stride), BasicBlock(outputs, outputs, 1)
            self.add_module(f"layer{number}", nn.Sequential(*blocks))
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> list[Tensor]:
        """Features from fine to coarse: 1/2, 1/4, ... 1/32 of the picture."""
        levels = [self.bn1(self.conv1(x)).relu()]
        x = functional.max_pool2d(levels[0], 3, 2, 1)
        for number in range(1, len(RESNET)):
            x = self.get_submodule(f"layer{number}")(x)
            levels.append(x)
        return levels


class SmallBackbone(nn.Module):
    """One convolution of stride 2 a level."""

    def __init__(self) -> None:
        super().__init__()
        self.levels = nn.ModuleList(nn.Conv2d(a, b, 3, 2, 1) for a, b in pairwise((3, *SMALL)))

    def forward(self, x: Tensor) -> list[Tensor]:
        """Features from fine to coarse: 1/2, 1/4, 1/8, 1/16 of the picture."""
        levels = []
        for convolution in self.levels:
            x = functional.leaky_relu(convolution(x), 0.1)
            levels.append(x)
        return levels


class Up(nn.Module):
    """Twice the resolution by a transposed convolution, the skip beside it, then 3x3 convolutions."""

    def __init__(self, inputs: int, skip: int, outputs: int, convolutions: int) -> None:
        super().__init__()
        self.up = nn.ConvTranspose2d(inputs, outputs, 2, 2)
        widths = (outputs + skip, *[outputs] * convolutions)
        self.convolutions = nn.ModuleList(nn.Conv2d(a, b, 3, padding=1) for a, b in pairwise(widths))

    def forward(self, x: Tensor, skip: Tensor | None = None) -> Tensor:
        """[N, inputs, h, w] and [N, skip, 2 h, 2 w] to [N, outputs, 2 h, 2 w]."""
        x = self.up(x) if skip is None else torch.cat([self.up(x), skip], dim=1)
        for convolution in self.convolutions:
            x = functional.leaky_relu(convolution(x), 0.1)
        return x


class ReferenceEncoder(nn.Module):
    """Feature maps and visibility of a reference picture."""

    def __init__(self, backbone: str, outputs: int) -> None:
        super().__init__()
        small = backbone == "small"
        widths, finest, lifts = (SMALL, 1, 2) if small else (RESNET, 0, 3)
        self.multiple = 2 ** len(widths)
        self.backbone = SmallBackbone() if small else ResNet18()
        steps = [(widths[k + 1], widths[k]) for k in reversed(range(finest, len(widths) - 1))]
        self.ups = nn.ModuleList(Up(deep, skip, skip, 1 if small else 2) for deep, skip in steps)
        self.head = nn.Conv2d(widths[finest], outputs, 1)
        shallower = widths[::-1][: lifts + 1]
        self.lifts = nn.ModuleList(Up(a, 0, b, 1) for a, b in pairwise(shallower))
        self.visible = nn.Conv2d(shallower[-1], 1, 1)
        with torch.no_grad():
            self.visible.weight.zero_()
            assert self.visible.bias is not None
            self.visible.bias.fill_(math.log(VISIBLE_AT_FIRST / (1 - VISIBLE_AT_FIRST)))

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        """Maps [outputs, h, w] at 1/4 (small) or 1/2 of the picture, and m [h, w] in (0, 1) at 1/4 of it."""
        levels = self.backbone(picture)
        x = levels[-1]
        for up, skip in zip(self.ups, reversed(levels[-1 - len(self.ups) : -1]), strict=True):
            x = up(x, skip)
        seen = levels[-1]
        for lift in self.lifts:
            seen = lift(seen)
        return self.head(x)[0], torch.sigmoid(self.visible(seen))[0, 0]


def load_resnet(encoder: ReferenceEncoder, path: Path) -> None:
    """Take over ResNet-18 weights: a .safetensors or torch file with torchvision's names; its classifier is ignored.

    Raises:
        InputError: missing, damaged, or not a ResNet-18.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file", expected="weights of ResNet-18", fix="correct HYDROVIEWS_RESNET18")
    try:
        safe = path.suffix == ".safetensors"
        state = load_file(path) if safe else torch.load(path, map_location="cpu", weights_only=True)
        wanted = encoder.backbone.state_dict()
        encoder.backbone.load_state_dict({name: state[name] for name in wanted})
    except (*UNREADABLE, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not weights of ResNet-18", found=f"{type(error).__name__}: {error}") from error
