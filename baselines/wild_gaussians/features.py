"""Frozen networks that see what is in a picture: DINOv2 (Oquab et al. 2023), as in WildGaussians, or LPIPS' AlexNet.

Pictures of one thing have features that point the same way; 1 - cosine is how unlike they are. How large it is for a
render that is merely not sharp yet, and how large for something else altogether, is another matter in each network:
`alike` and `unlike` are the values that stand for 0 and 1 in the uncertainty's loss.
"""

import sys
from typing import ClassVar, Literal, Protocol

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hydroviews.errors import InputError
from hydroviews.metrics.lpips import MINIMUM_SIZE, activations, weights_of
from hydroviews.scene.images import Image

Wanted = Literal["dinov2", "alexnet", "auto"]
LONGEST = 350  # pixels that the longer side of a picture is shrunk to
LEVELS = 3  # of AlexNet's convolutions
PATCH = 14  # pixels of DINOv2's patches
BLOCK = 5  # of its twelve: the authors look at the sixth
# The code that is fetched and run is that of one commit.
REPOSITORY, MODEL = "facebookresearch/dinov2:12592a9bdfea0a6e4ee4767cd5a8d3195c0e3509", "dinov2_vits14_reg"
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet


class Features(Protocol):
    """A frozen network."""

    name: ClassVar[str]
    alike: ClassVar[float]  # 1 - cosine that stands for 0
    unlike: ClassVar[float]  # and for 1

    def __call__(self, image: Image) -> Tensor:
        """Features [C, h, w] of a picture [H, W, 3] in [0, 1], on the network's device.

        Raises:
            InputError: the picture is too small.
        """


class AlexNet:
    """The third convolution's 384 channels, one position for 16x16 pixels, from the weights that LPIPS comes with.

    Calibrated on photographs of BSDS500 at 320 pixels: nineteen in twenty positions of a photograph blurred with a
    standard deviation of 1 pixel are less unlike the sharp one than `alike`; `unlike` is the median of two positions
    in one photograph. docs/wild-gaussians.md has the table.
    """

    name: ClassVar[str] = "alexnet"
    alike: ClassVar[float] = 0.34
    unlike: ClassVar[float] = 0.84

    def __init__(self, device: str) -> None:
        self._device = torch.device(device)
        weights_of("alex", self._device)  # now rather than at the first picture, so that a lack of them is told early

    @torch.no_grad()
    def __call__(self, image: Image) -> Tensor:
        """See Features."""
        if min(image.shape[:2]) < MINIMUM_SIZE["alex"]:
            raise InputError(
                "uncertainty: the photographs are too small",
                found=f"{image.shape[1]}x{image.shape[0]} pixels",
                expected=f"at least {MINIMUM_SIZE['alex']} a side",
            )
        return activations("alex", planes(shrunk(image), self._device)[None], LEVELS)[-1][0]


class DinoV2:
    """ViT-S/14 with registers by torch.hub: 384 channels, one position for 14x14 pixels; unlike is a cosine of 0.5."""

    name: ClassVar[str] = "dinov2"
    alike: ClassVar[float] = 0.0
    unlike: ClassVar[float] = 0.5

    def __init__(self, device: str) -> None:
        # The validation that is skipped knows branches and tags alone.
        network = torch.hub.load(REPOSITORY, MODEL, trust_repo=True, verbose=False, skip_validation=True)
        self._network = network.to(device).eval()
        self._mean, self._deviation = (torch.tensor(v, device=device).view(3, 1, 1) for v in (MEAN, DEVIATION))

    @torch.no_grad()
    def __call__(self, image: Image) -> Tensor:
        """See Features."""
        small = shrunk(image)
        height, width = (PATCH * -(-side // PATCH) for side in small.shape[:2])
        whole = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
        x = (planes(whole, self._mean.device) - self._mean) / self._deviation
        return self._network.get_intermediate_layers(x[None], n=[BLOCK], reshape=True)[0][0]


def find_features(wanted: Wanted, device: str) -> Features:
    """The network asked for; for "auto" DINOv2 where it can be fetched, else AlexNet, and it is said.

    Raises:
        InputError: DINOv2 is asked for and cannot be had; or AlexNet's weights can neither be found nor fetched.
    """
    if wanted == "alexnet":
        return AlexNet(device)
    try:
        return DinoV2(device)
    except (OSError, RuntimeError, ImportError) as error:
        if wanted == "dinov2":
            fix = "connect to the net once, or choose the features alexnet"
            raise InputError(f"{REPOSITORY}: torch.hub cannot load {MODEL}", found=error, fix=fix) from error
        print(f"uncertainty: no DINOv2 ({error}); the features are AlexNet's", file=sys.stderr)
        return AlexNet(device)


def unlikeness(one: Tensor, other: Tensor) -> Tensor:
    """1 - cosine of features [C, h, w], [h, w] in [0, 2]; 0 where both have none."""
    return (normalize(one, dim=0) - normalize(other, dim=0)).square().sum(dim=0) / 2


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
