"""Frozen networks that see what is in a picture: DINOv2 (Oquab et al. 2023), or LPIPS' AlexNet and VGG.

Which of them is a setting, which runs record: nothing is chosen by what can be had.

Pictures of one thing have features that point the same way; 1 - cosine is how unlike they are. How large it is for a
render that is merely not sharp yet, and how large for something else altogether, is another matter in each network:
`alike` and `unlike` are the values that stand for 0 and 1 in the uncertainty's loss.
"""

from typing import ClassVar, Literal, Protocol

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from baselines.encoders.dinov2 import PATCH, load_dinov2, memory_of
from hydroviews.errors import InputError
from hydroviews.metrics.lpips import MINIMUM_SIZE, activations, weights_of
from hydroviews.scene.images import Image

Network = Literal["dinov2", "alexnet", "vgg"]
CalibratedNetwork = Literal["dinov2", "alexnet"]
CALIBRATED: tuple[CalibratedNetwork, ...] = ("dinov2", "alexnet")
LONGEST = 350  # pixels that the longer side of a picture is shrunk to
LEVELS = 3  # of AlexNet's convolutions, and of VGG's
FLAT = 1e-6  # features that vary less are left out
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet


class Features(Protocol):
    """A frozen network."""

    def __call__(self, image: Image) -> Tensor:
        """Features [C, h, w] of a picture [H, W, 3] in [0, 1], on the network's device.

        Raises:
            InputError: the picture is too small.
        """


class CalibratedFeatures(Features, Protocol):
    """A frozen network whose features of two pictures can be compared."""

    name: ClassVar[str]
    alike: ClassVar[float]  # 1 - cosine that stands for 0
    unlike: ClassVar[float]  # and for 1


class AlexNet:
    """The third convolution's 384 channels, one position for 16x16 pixels, from the weights that LPIPS comes with.

    Calibrated on photographs of BSDS500 at 320 pixels: nineteen in twenty positions of a photograph blurred with a
    standard deviation of 1 pixel are less unlike the sharp one than `alike`; `unlike` is the median of two positions
    in one photograph. docs/experiments/2026-11-wild-gaussians.md has the table.
    """

    name: ClassVar[str] = "alexnet"
    alike: ClassVar[float] = 0.34
    unlike: ClassVar[float] = 0.84

    def __init__(self, device: str) -> None:
        self._device = torch.device(device)
        weights_of("alex", self._device)  # now rather than at the first picture, so that a lack of them shows early

    @torch.no_grad()
    def __call__(self, image: Image) -> Tensor:
        """See Features."""
        return _of_lpips("alex", image, self._device)


class Vgg:
    """The last convolution's 256 channels before VGG's third pooling, a position for 4x4 pixels."""

    def __init__(self, device: str) -> None:
        self._device = torch.device(device)
        weights_of("vgg", self._device)  # now rather than at the first picture, so that a lack of them shows early

    @torch.no_grad()
    def __call__(self, image: Image) -> Tensor:
        """See Features."""
        return _of_lpips("vgg", image, self._device)


class DinoV2:
    """ViT-S/14 with registers, sixth block: 384 channels, a position for 14x14 pixels; unlike is a cosine of 0.5."""

    name: ClassVar[str] = "dinov2"
    alike: ClassVar[float] = 0.0
    unlike: ClassVar[float] = 0.5

    def __init__(self, device: str) -> None:
        self._network = load_dinov2(torch.device(device))
        self._mean, self._deviation = (torch.tensor(v, device=device).view(3, 1, 1) for v in (MEAN, DEVIATION))

    @torch.no_grad()
    def __call__(self, image: Image) -> Tensor:
        """See Features."""
        small = shrunk(image)
        height, width = (PATCH * -(-side // PATCH) for side in small.shape[:2])
        whole = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
        x = (planes(whole, self._mean.device) - self._mean) / self._deviation
        with memory_of(x.device):
            return self._network(x)


def frozen(network: Network, device: str) -> Features:
    """The network of a name, on a device.

    Raises:
        InputError: its weights can neither be found nor fetched, are not the published ones, or do not fit the memory.
    """
    return Vgg(device) if network == "vgg" else calibrated(network, device)


def calibrated(network: CalibratedNetwork, device: str) -> CalibratedFeatures:
    """The network of a name, on a device.

    Raises:
        InputError: see `frozen`.
    """
    return DinoV2(device) if network == "dinov2" else AlexNet(device)


def _of_lpips(network: Literal["alex", "vgg"], image: Image, device: torch.device) -> Tensor:
    """Activations [C, h, w] of a picture [H, W, 3] in one of LPIPS' networks, at most LONGEST pixels a side.

    Raises:
        InputError: the picture is too small.
    """
    if min(image.shape[:2]) < MINIMUM_SIZE[network]:
        raise InputError(
            "features: the photographs are too small",
            found=f"{image.shape[1]}x{image.shape[0]} pixels",
            expected=f"at least {MINIMUM_SIZE[network]} a side",
        )
    return activations(network, planes(shrunk(image), device)[None], LEVELS)[-1][0]


def unlikeness(one: Tensor, other: Tensor) -> Tensor:
    """1 - cosine of features [C, h, w], [h, w] in [0, 2]; 0 where both have none."""
    return (normalize(one, dim=0) - normalize(other, dim=0)).square().sum(dim=0) / 2


def standardise(features: list[Tensor]) -> None:
    """Give features [C, h, w] of pictures mean 0 and deviation 1 over all of them, in half precision, to keep many.

    They are replaced one by one, so that both precisions of all are never there at once. What does not vary, as in
    pictures of one colour, becomes 0.
    """
    number = sum(seen[0].numel() for seen in features)
    mean = sum((seen.double().sum(dim=(1, 2)) for seen in features), torch.zeros(())) / number
    squares = sum(
        ((seen.double() - mean[:, None, None]).square().sum(dim=(1, 2)) for seen in features), torch.zeros(())
    )
    deviation = (squares / number).sqrt()
    factor = torch.where(deviation > FLAT, 1 / deviation.clamp(min=FLAT), 0.0)
    for view, seen in enumerate(features):
        features[view] = ((seen.double() - mean[:, None, None]) * factor[:, None, None]).half()


def shrunk(image: Image) -> Image:
    """The picture averaged over areas, if it is longer than LONGEST."""
    height, width = image.shape[:2]
    factor = LONGEST / max(height, width)
    if factor >= 1:
        return image
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


def planes(image: Image, device: torch.device) -> Tensor:
    """[3, H, W]."""
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))).to(device)
