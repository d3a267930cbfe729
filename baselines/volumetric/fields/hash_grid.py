"""A multi-resolution hash grid (Mueller et al. 2022): kernels on the CPU, plain torch elsewhere, the same numbers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from baselines.splatting.backends.warm_up import compile_apart
from baselines.volumetric.fields.hash_kernels import FEATURES, PRIME_Y, PRIME_Z, look_up, look_up_gradient

SPREAD = 1e-4  # entries start uniformly within this distance of zero (Mueller et al. 2022)


@dataclass(frozen=True)
class GridConfig:
    """Sizes of a hash grid."""

    levels: int = 8
    log2_entries: int = 16  # log2 of the number of entries per level
    coarsest: int = 16  # cells along an axis at the coarsest level
    finest: int = 1024

    def resolutions(self) -> list[int]:
        """Cells along an axis of every level, in geometric progression (Mueller et al. 2022, equations 2 and 3)."""
        growth = (self.finest / self.coarsest) ** (1 / max(1, self.levels - 1))
        return [int(self.coarsest * growth**level + 1e-6) for level in range(self.levels)]


class HashGrid(nn.Module):
    """Features of points in the unit cube; positions get no gradient."""

    def __init__(self, config: GridConfig, generator: torch.Generator):
        super().__init__()
        start = torch.empty(config.levels, 2**config.log2_entries, FEATURES)
        self.tables = nn.Parameter(start.uniform_(-SPREAD, SPREAD, generator=generator))
        self.resolutions = config.resolutions()
        self.width = config.levels * FEATURES

    def forward(self, points: Tensor) -> Tensor:
        """Features [N, L 4] of points [N, 3] in [0, 1]; what lies outside is moved to the border."""
        if points.is_cuda:
            return interpolate(points, self.tables, self.resolutions)
        features: Tensor = _LookUp.apply(points, self.tables, self.resolutions)
        return features


class _LookUp(torch.autograd.Function):
    """The kernels as a differentiable function of the tables."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, tables: Tensor, resolutions: list[int]) -> Tensor:
        cells = np.asarray(resolutions, np.int64)
        features = torch.empty(len(points), *tables.shape[::2], dtype=tables.dtype)
        look_up(points.contiguous().numpy(), tables.detach().numpy(), cells, features.numpy())
        ctx.save_for_backward(points)
        ctx.cells, ctx.shape = cells, tables.shape
        return features.flatten(1)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor, None]:
        (points,) = ctx.saved_tensors
        gradient = gradients[0].contiguous().view(len(points), ctx.shape[0], FEATURES)
        tables_gradient = torch.zeros(ctx.shape, dtype=gradient.dtype)
        look_up_gradient(points.contiguous().numpy(), gradient.numpy(), ctx.cells, tables_gradient.numpy())
        return None, tables_gradient, None


def interpolate(points: Tensor, tables: Tensor, resolutions: list[int]) -> Tensor:
    """What the kernels calculate, in plain torch on any device: features [N, L F] of points [N, 3]."""
    size = tables.shape[1]
    clamped = points.clamp(0, 1)
    steps = torch.tensor([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)], device=points.device)
    features = []
    for table, cells in zip(tables, resolutions, strict=True):
        scaled = clamped * cells
        first = scaled.long().clamp_max(cells - 1)
        within = (scaled - first)[:, None]
        x, y, z = (first[:, None] + steps).unbind(-1)  # [N, 8]
        if (cells + 1) ** 3 <= size:
            at = x + (cells + 1) * (y + (cells + 1) * z)
        else:
            at = (x ^ y * PRIME_Y ^ z * PRIME_Z) & (size - 1)
        shares = torch.where(steps.bool(), within, 1 - within).prod(-1)
        features.append((shares[..., None] * table[at]).sum(1))
    return torch.cat(features, 1)


def warm_up() -> None:
    """Load the kernels, so that training time is training."""
    here = Path(__file__).parent
    compile_apart("hash-grid", f"from {__name__} import exercise_kernels; exercise_kernels()", here.glob("*kernels.py"))
    exercise_kernels()


def exercise_kernels() -> None:
    """One lookup and its gradient."""
    grid = HashGrid(GridConfig(levels=2, log2_entries=10), torch.Generator().manual_seed(0))
    grid(torch.rand(2, 3, generator=torch.Generator().manual_seed(0))).sum().backward()
