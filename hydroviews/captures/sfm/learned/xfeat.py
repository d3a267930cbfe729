"""XFeat: learned keypoints and descriptors of pictures, by its published weights.

Potje et al., XFeat: Accelerated Features for Lightweight Image Matching, CVPR 2024.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from hydroviews.captures.sfm.learned.weights import XFEAT, Weights, load_weights

CELL = 8  # pixels: the network says for each cell which of its pixels is a keypoint, if any
MULTIPLE = 32  # of which the sides of a picture are multiples, as the network halves them five times
THRESHOLD = 0.05  # probability of a keypoint
NEIGHBOURHOOD = 5  # pixels: of two keypoints nearer than half of it, the likelier one stays
STRIDES = {"block1.1": 2, "block1.3": 2, "block3.0": 2, "block4.0": 2, "block5.0": 2}
LINEAR_ENDS = ("block_fusion", "keypoint_head", "heatmap_head")  # blocks whose last convolution has no ReLU


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of a picture, the strongest first.

    `places` [K, 2], pixels with the centre of the first at (0.5, 0.5); `descriptors` [K, 64], of length 1; `scores`
    [K], probability of a keypoint times its reliability.
    """

    places: Tensor
    descriptors: Tensor
    scores: Tensor


class XFeat:
    """The network, and the keypoints that are read from what it gives."""

    def __init__(self, device: str = "cpu", weights: Weights | None = None) -> None:
        """Args: device, as torch calls it; weights, the published ones if not given."""
        given = load_weights(XFEAT) if weights is None else weights
        self.device = device
        self.weights = {name: weight.to(device) for name, weight in given.items()}

    @torch.inference_mode()
    def detect(self, grey: Tensor, size: tuple[int, int], count: int) -> Keypoints:
        """Resample a picture and find its keypoints.

        Args:
            grey: [H, W], [0, 1].
            size: height and width to resample to, made multiples of 32.
            count: of keypoints, at most.

        Returns:
            Keypoints in pixels of `grey`, on the CPU.
        """
        height, width = (max(MULTIPLE, round(side / MULTIPLE) * MULTIPLE) for side in size)
        resampled = F.interpolate(
            grey.to(self.device)[None, None], (height, width), mode="bicubic", align_corners=False
        )
        features, cells, reliability = self.forward(resampled)
        heat = keypoint_map(cells)
        found = local_maxima(heat)
        score = heat[found[:, 1], found[:, 0]] * _sample(reliability, found, "bilinear")[:, 0]
        strongest = torch.argsort(-score, stable=True)[:count]
        places = found[strongest]
        descriptors = F.normalize(_sample(F.normalize(features, dim=1), places, "bicubic"), dim=-1)
        scale = torch.tensor([grey.shape[1] / width, grey.shape[0] / height], device=self.device)
        return Keypoints(((places + 0.5) * scale).cpu(), descriptors.cpu(), score[strongest].cpu())

    def forward(self, grey: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What the network gives for pictures [B, 1, H, W], sides multiples of 32.

        Returns:
            Features [B, 64, H/8, W/8]; logits [B, 65, H/8, W/8] of the pixels of each cell in rows, the last of none;
            reliability [B, 1, H/8, W/8] in [0, 1].
        """
        grey = F.instance_norm(grey)
        skip = self._convolve("skip1.1", F.avg_pool2d(grey, 4))
        third = self._block("block3", self._block("block2", self._block("block1", grey) + skip))
        fourth = self._block("block4", third)
        fifth = self._block("block5", fourth)
        coarse = [F.interpolate(one, third.shape[-2:], mode="bilinear") for one in (fourth, fifth)]
        features = self._block("block_fusion", third + coarse[0] + coarse[1])
        cells = F.pixel_unshuffle(grey, CELL)
        return features, self._block("keypoint_head", cells), torch.sigmoid(self._block("heatmap_head", features))

    def _block(self, name: str, x: Tensor) -> Tensor:
        """A row of convolutions, each with ReLU but the last of `LINEAR_ENDS`."""
        count = sum(key.startswith(f"{name}.") and key.endswith(".weight") for key in self.weights)
        for i in range(count):
            x = self._convolve(f"{name}.{i}", x)
            if i + 1 < count or name not in LINEAR_ENDS:
                x = F.relu(x)
        return x

    def _convolve(self, layer: str, x: Tensor) -> Tensor:
        kernel = self.weights[layer + ".weight"]
        return F.conv2d(x, kernel, self.weights[layer + ".bias"], STRIDES.get(layer, 1), padding=kernel.shape[-1] // 2)


def keypoint_map(cells: Tensor) -> Tensor:
    """The probability of a keypoint [H, W] from the logits [1, 65, H/8, W/8]."""
    return F.pixel_shuffle(F.softmax(cells, dim=1)[:, : CELL * CELL], CELL)[0, 0]


def local_maxima(heat: Tensor) -> Tensor:
    """Pixels [K, 2], x first, that are likely and the likeliest of their neighbourhood."""
    highest = F.max_pool2d(heat[None], NEIGHBOURHOOD, 1, NEIGHBOURHOOD // 2)[0]
    return torch.nonzero((heat == highest) & (heat > THRESHOLD)).flip(-1)


def _sample(grid: Tensor, pixels: Tensor, mode: str) -> Tensor:
    """Values [K, C] of a grid [1, C, H/8, W/8] at pixels [K, 2], placed as the network was trained with."""
    last = torch.tensor([grid.shape[-1], grid.shape[-2]], device=grid.device) * CELL - 1
    return F.grid_sample(grid, (2 * pixels / last - 1)[None, None], mode=mode, align_corners=False)[0, :, 0].T


def working_size(height: int, width: int, enlarged: float, longest: int) -> tuple[int, int]:
    """Height and width of a picture `enlarged` so many times, but with its longer side no longer than `longest`."""
    scale = min(enlarged, longest / max(height, width))
    return math.ceil(height * scale), math.ceil(width * scale)
