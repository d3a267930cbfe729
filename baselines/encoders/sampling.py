"""Reading feature maps at points, and keeping learned points within them (GS-W)."""

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from hydroviews.scene.cameras import Camera


class _Bilinear(torch.autograd.Function):
    """Values between four rows each: rows [R, C], corners [n, 4], shares of the right and the lower ones [n].

    A pixel's channels lie side by side, which on a CPU makes this three times as fast as grid_sample with its gradient.
    """

    @staticmethod
    def forward(context: Any, rows: Tensor, corners: Tensor, right: Tensor, low: Tensor) -> Tensor:
        context.save_for_backward(rows, corners, right, low)
        return _blended(rows, corners, _outer(1 - low, low, 1 - right, right))

    @staticmethod
    def backward(context: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        rows, corners, right, low = context.saved_tensors
        weights, one = _outer(1 - low, low, 1 - right, right), torch.ones_like(low)
        by_rows = torch.zeros_like(rows)
        for k in range(4):
            by_rows.index_add_(0, corners[:, k], gradient * weights[:, k : k + 1])
        if not context.needs_input_grad[2]:
            return by_rows, None, None, None
        by_right = (_blended(rows, corners, _outer(1 - low, low, -one, one)) * gradient).sum(dim=1)
        by_low = (_blended(rows, corners, _outer(-one, one, 1 - right, right)) * gradient).sum(dim=1)
        return by_rows, None, by_right, by_low


def _outer(upper: Tensor, lower: Tensor, left: Tensor, right: Tensor) -> Tensor:
    """Weights [n, 4] of the corners: upper left, upper right, lower left, lower right."""
    return torch.stack([upper * left, upper * right, lower * left, lower * right], dim=1)


def _blended(rows: Tensor, corners: Tensor, weights: Tensor) -> Tensor:
    return functional.embedding_bag(corners, rows, per_sample_weights=weights, mode="sum")


def sample(maps: Tensor, coordinates: Tensor) -> Tensor:
    """Bilinear values of maps [M, C, h, w] at M points each [N, M, 2], as [N, M C], one map's channels after another's.

    Coordinates are x and y; a map reaches from -1 to 1, from the outer edge of its first pixel to that of its last.
    Beyond the outermost pixel centres its border's values go on.
    """
    count, channels, height, width = maps.shape
    x = ((coordinates[..., 0] + 1) * (width / 2) - 0.5).clamp(0, width - 1)
    y = ((coordinates[..., 1] + 1) * (height / 2) - 0.5).clamp(0, height - 1)
    left, top = x.detach().floor().clamp(max=max(width - 2, 0)), y.detach().floor().clamp(max=max(height - 2, 0))
    first = (top * width + left).long() + height * width * torch.arange(count, device=maps.device)
    across, down = min(1, width - 1), width * min(1, height - 1)
    corners = first.flatten()[:, None] + torch.tensor([0, across, down, across + down], device=maps.device)
    rows = maps.permute(0, 2, 3, 1).reshape(-1, channels)
    values: Tensor = _Bilinear.apply(rows, corners, (x - left).flatten(), (y - top).flatten())
    return values.reshape(len(coordinates), count * channels)


def projected(means: Tensor, camera: Camera) -> Tensor:
    """Where a camera sees points [N, 3] in its picture [N, 2], from -1 to 1 between its edges."""
    pose = torch.from_numpy(camera.world_to_camera).to(means)
    x, y, z = (means @ pose[:3, :3].T + pose[:3, 3]).unbind(dim=1)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    return torch.stack([2 * u / camera.width - 1, 2 * v / camera.height - 1], dim=1)


class _Boxed(torch.autograd.Function):
    """The identity, whose gradient has that of weight mean(relu(|x| - 1)) added."""

    @staticmethod
    def forward(context: Any, x: Tensor, weight: float) -> Tensor:
        context.save_for_backward(x)
        context.weight = weight
        return x.clone()

    @staticmethod
    def backward(context: Any, gradient: Tensor) -> tuple[Tensor, None]:
        (x,) = context.saved_tensors
        return gradient + context.weight / max(x.numel(), 1) * x.sign() * (x.abs() > 1), None


def boxed(coordinates: Tensor, weight: float) -> Tensor:
    """The coordinates themselves; whatever loss they lead to, `weight` mean(relu(|coordinate| - 1)) is added to it.

    Beyond the edge of a map its values no longer change, so nothing else would call a coordinate back.
    """
    boxed: Tensor = _Boxed.apply(coordinates, weight)
    return boxed
