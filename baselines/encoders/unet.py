"""U-Nets that look at a picture, and the visibility mask that they predict (GS-W, Zhang et al. 2024).

Pictures are [1, 3, H, W] with values around zero, both sides multiples of `multiple`. There is no batch normalisation
in training: a batch is one picture, whose own statistics are the very appearance that is to be encoded. ResNet's layers
keep the statistics of their weights; without weights these are 0 and 1.
"""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

VISIBLE_AT_FIRST = 0.98  # the mask before the first step, everywhere
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


class Backbone(nn.Module):
    """Features of a picture at several resolutions, and where decoders of a U-Net begin and end."""

    widths: tuple[int, ...]  # channels from fine to coarse
    finest: int  # the level at which maps end
    lifts: int  # from the coarsest level to the mask's

    @property
    def multiple(self) -> int:
        """Both sides of a picture are multiples of this."""
        return 2 ** len(self.widths)


class ResNet18(Backbone):
    """ResNet-18 (He et al. 2016) without its classifier; weights of torchvision's fit by name."""

    widths, finest, lifts = RESNET, 0, 3

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


class SmallBackbone(Backbone):
    """One convolution of stride 2 a level."""

    widths, finest, lifts = SMALL, 1, 2

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


def make_backbone(name: str) -> Backbone:
    """Of the name that settings give it."""
    return SmallBackbone() if name == "small" else ResNet18()


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


def visibility_decoder(backbone: Backbone) -> tuple[nn.ModuleList, nn.Conv2d]:
    """The U-Net's decoder of the visibility mask: steps up, and a last layer that finds everything seen."""
    shallower = backbone.widths[::-1][: backbone.lifts + 1]
    lifts = nn.ModuleList(Up(a, 0, b, 1) for a, b in pairwise(shallower))
    last = nn.Conv2d(shallower[-1], 1, 1)
    with torch.no_grad():
        last.weight.zero_()
        assert last.bias is not None
        last.bias.fill_(math.log(VISIBLE_AT_FIRST / (1 - VISIBLE_AT_FIRST)))
    return lifts, last


def at_size(mask: Tensor, size: tuple[int, int]) -> Tensor:
    """A mask [h, w] at another height and width, bilinear."""
    return functional.interpolate(mask[None, None], size=size, mode="bilinear", align_corners=False)[0, 0]


def visibility(lifts: nn.ModuleList, last: nn.Conv2d, seen: Tensor) -> Tensor:
    """m [h, w] in (0, 1) at 1/4 of the picture, from its coarsest features [1, C, h', w']."""
    for lift in lifts:
        seen = lift(seen)
    return torch.sigmoid(last(seen))[0, 0]


class PictureEncoder(nn.Module):
    """A U-Net whose decoders derived classes add; both sides of its pictures are multiples of `multiple`."""

    def __init__(self, backbone: str) -> None:
        super().__init__()
        self.backbone = make_backbone(backbone)
        self.multiple = self.backbone.multiple
