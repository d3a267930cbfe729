"""LighterGlue: which keypoints of two pictures are the same, by attention, with the weights published for XFeat.

The network is LightGlue's (Lindenberger et al., LightGlue: Local Feature Matching at Light Speed, ICCV 2023) with 6
layers, 96 channels and one head.

All layers are run and all keypoints kept: on a CPU, leaving some out early costs more than it saves.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from hydroviews.captures.sfm.learned.mutual import mutual_best
from hydroviews.captures.sfm.learned.weights import LIGHTERGLUE, Weights, load_weights
from hydroviews.captures.sfm.learned.xfeat import Keypoints

LAYERS = 6
THRESHOLD = 0.1  # confidence that two keypoints are the same


@dataclass(frozen=True)
class Prepared:
    """What matching needs of one picture, whatever the other: channels [K, 96] and angles [K, 96] of their places."""

    channels: Tensor
    cosines: Tensor
    sines: Tensor


class LighterGlue:
    """The network, and the matches that are read from what it gives."""

    def __init__(self, device: str = "cpu", weights: Weights | None = None) -> None:
        """Args: device, as torch calls it; weights, the published ones if not given."""
        given = load_weights(LIGHTERGLUE) if weights is None else weights
        self.device = device
        self.weights = {name: weight.to(device) for name, weight in given.items()}

    @torch.inference_mode()
    def prepare(self, keypoints: Keypoints, size: tuple[int, int]) -> Prepared:
        """Encode a picture's keypoints and run the first layer's self-attention, which depends on it alone.

        Args:
            keypoints: K, of XFeat.
            size: height and width of the picture.
        """
        extent = torch.tensor([size[1], size[0]], dtype=torch.float32)
        places = ((keypoints.places - extent / 2) / (extent.max() / 2)).to(self.device)
        angles = F.linear(places, self.weights["posenc.Wr.weight"]).repeat_interleave(2, -1)
        channels = self._linear("input_proj", keypoints.descriptors.to(self.device))
        return self._attend_self(Prepared(channels, torch.cos(angles), torch.sin(angles)), 0)

    @torch.inference_mode()
    def match(self, first: Prepared, second: Prepared) -> tuple[Tensor, Tensor]:
        """Pairs of keypoints that are each other's likeliest.

        Returns:
            Indices [M, 2] into the keypoints of both, the first in order, and confidences [M] above 0.1; on the CPU.
        """
        if not len(first.channels) or not len(second.channels):
            return torch.zeros((0, 2), dtype=torch.int64), torch.zeros(0)
        for layer in range(LAYERS):
            if layer:
                first, second = self._attend_self(first, layer), self._attend_self(second, layer)
            first, second = self._attend_cross(first, second, layer)
        likelihood = self.assignment(first.channels, second.channels)
        own, others = mutual_best(likelihood, math.log(THRESHOLD))
        return torch.stack([own, others], 1).cpu(), likelihood[own, others].exp().cpu()

    def assignment(self, first: Tensor, second: Tensor) -> Tensor:
        """Log of the confidence [K, L] that keypoints, by their channels [K, 96] and [L, 96], are the same."""
        name = f"log_assignment.{LAYERS - 1}"
        one, other = (self._linear(f"{name}.final_proj", x) / x.shape[-1] ** 0.25 for x in (first, second))
        similar = one @ other.T
        has, has_other = (F.logsigmoid(self._linear(f"{name}.matchability", x)) for x in (first, second))
        return F.log_softmax(similar, 1) + F.log_softmax(similar, 0) + has + has_other.T

    def _attend_self(self, one: Prepared, layer: int) -> Prepared:
        name = f"transformers.{layer}.self_attn"
        query, key, value = self._linear(f"{name}.Wqkv", one.channels).unflatten(-1, (-1, 3)).unbind(-1)
        query, key = (x * one.cosines + _quarter_turn(x) * one.sines for x in (query, key))
        message = self._linear(f"{name}.out_proj", _attention(query, key, value))
        return Prepared(self._updated(name, one.channels, message), one.cosines, one.sines)

    def _attend_cross(self, first: Prepared, second: Prepared, layer: int) -> tuple[Prepared, Prepared]:
        name = f"transformers.{layer}.cross_attn"
        keys = [self._linear(f"{name}.to_qk", x.channels) for x in (first, second)]
        values = [self._linear(f"{name}.to_v", x.channels) for x in (first, second)]
        messages = [_attention(keys[i], keys[1 - i], values[1 - i]) for i in (0, 1)]
        updated = [
            self._updated(name, x.channels, self._linear(f"{name}.to_out", message))
            for x, message in zip((first, second), messages, strict=True)
        ]
        one, other = (Prepared(c, x.cosines, x.sines) for c, x in zip(updated, (first, second), strict=True))
        return one, other

    def _updated(self, name: str, channels: Tensor, message: Tensor) -> Tensor:
        hidden = self._linear(f"{name}.ffn.0", torch.cat([channels, message], -1))
        gain, bias = (self.weights[f"{name}.ffn.1.{what}"] for what in ("weight", "bias"))
        hidden = F.gelu(F.layer_norm(hidden, hidden.shape[-1:], gain, bias))
        return channels + self._linear(f"{name}.ffn.3", hidden)

    def _linear(self, layer: str, x: Tensor) -> Tensor:
        return F.linear(x, self.weights[layer + ".weight"], self.weights[layer + ".bias"])


def _attention(query: Tensor, key: Tensor, value: Tensor) -> Tensor:
    query, key, value = (x[None, None].contiguous() for x in (query, key, value))
    return F.scaled_dot_product_attention(query, key, value)[0, 0]


def _quarter_turn(x: Tensor) -> Tensor:
    """Each pair of channels (a, b) as (-b, a), which a rotation by an angle adds times its sine."""
    a, b = x.unflatten(-1, (-1, 2)).unbind(-1)
    return torch.stack([-b, a], -1).flatten(-2)
