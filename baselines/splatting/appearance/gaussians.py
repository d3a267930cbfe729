"""The Gaussians that a view may show, in the colours that an appearance gives them there.

Every training imports this, and most have no appearance: torch, which takes longer to import than all else, is imported
where it is used.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import SHAPE, Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.constants import LOW_PASS
from hydroviews.scene.cameras import Camera

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from baselines.splatting.appearance.base import Appearance

REACH = 3.5  # standard deviations within which a Gaussian is seen at all
WIDENED = LOW_PASS**0.5  # pixels of standard deviation that are at most added to every splat's


class AppearanceGaussians:
    """The Gaussians in sight and their colours in numpy, and the way back for gradients to all Gaussians."""

    def __init__(self, gaussians: Gaussians, appearance: Appearance, camera: Camera, view: int, degree: int) -> None:
        import torch

        self._total, self._origin = len(gaussians), gaussians.origin
        local = moved(camera, self._origin)
        rows, self._leaves = in_sight(tensors(gaussians), local)
        self.rows: NDArray[np.int64] = rows.numpy()  # of those in sight, ascending
        for leaf in self._leaves.values():
            leaf.requires_grad_()
        self._sh_sets = appearance.sh_sets(self._leaves, local, view, degree)
        self.sh: NDArray[np.float32] = torch.stack([sh.detach() for sh in self._sh_sets]).numpy()  # [L, n, K, 3]
        shape = {name: self._leaves[name].detach().numpy() for name in SHAPE}
        self.gaussians = Gaussians(**shape, sh=self.sh[0], origin=self._origin)  # what the view shows

    def backward(self, gradient: Gaussians, by_sh_sets: NDArray[np.float32], buffers: BufferPool) -> Gaussians:
        """From gradients by what is rendered to those by all Gaussians; those of the network are in `.grad`.

        Args:
            gradient: of a loss by the Gaussians in sight; that by their colours is not used.
            by_sh_sets: of the loss by `sh`, [L, n, K, 3].
            buffers: the arrays returned are of them: the next call overwrites them.
        """
        import torch

        by_shape = [(self._leaves[name], getattr(gradient, name)) for name in SHAPE]
        ends = [*by_shape, *zip(self._sh_sets, by_sh_sets, strict=True)]
        learning = [(end, torch.from_numpy(value)) for end, value in ends if end.requires_grad]
        torch.autograd.backward([end for end, _ in learning], [value for _, value in learning])
        found = {
            name: self.spread(
                np.zeros(leaf.shape, np.float32) if leaf.grad is None else leaf.grad.numpy(), name, buffers
            )
            for name, leaf in self._leaves.items()
        }
        return Gaussians(**found, origin=self._origin)

    def spread(self, values: NDArray, name: str, buffers: BufferPool) -> NDArray:
        """Values [n, ...] of those in sight among those of all Gaussians [N, ...]; 0 for the others."""
        spread = buffers.array(f"all_{name}", (self._total, *values.shape[1:]), values.dtype)
        spread.fill(0)
        spread[self.rows] = values
        return spread


def with_appearance(gaussians: Gaussians, appearance: Appearance | None) -> Gaussians:
    """Gaussians with the features that an appearance wants them to start with."""
    return gaussians if appearance is None else replace(gaussians, features=appearance.features(gaussians))


def gaussians_in_view(
    gaussians: Gaussians, appearance: Appearance | None, camera: Camera, view: int, degree: int
) -> Gaussians:
    """What a view shows of the Gaussians, those in sight; themselves, without an appearance."""
    if appearance is None:
        return gaussians
    import torch

    with torch.no_grad():
        return AppearanceGaussians(gaussians, appearance, camera, view, degree).gaussians


def moved(camera: Camera, origin: NDArray[np.float64]) -> Camera:
    """The camera seen from another origin of the world."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] += pose[:3, :3] @ origin
    return replace(camera, world_to_camera=pose)


def tensors(gaussians: Gaussians, device: torch.device | None = None) -> dict[str, Tensor]:
    """The parameters on a device; on the CPU, which is the default, they share the Gaussians' memory."""
    import torch

    return {name: torch.from_numpy(value).to(device) for name, value in gaussians.state_dict().items()}


def in_sight(parameters: dict[str, Tensor], camera: Camera) -> tuple[Tensor, dict[str, Tensor]]:
    """The Gaussians that a camera may show: whole ones whose splats can touch the image.

    Generous, so that none that is shown is left out: a splat's standard deviation is at most the largest one of the
    Gaussian times the norm of the projection's Jacobian (Zwicker et al. 2002), and what renderers widen it by.

    Args:
        parameters: of all Gaussians.
        camera: of the view, relative to their origin.

    Returns:
        Their indices [n], ascending, and their parameters.
    """
    import torch

    means = parameters["means"].detach()
    pose = torch.from_numpy(camera.world_to_camera).to(means)
    x, y, z = (means @ pose[:3, :3].T + pose[:3, 3]).unbind(dim=1)
    before = z > 0
    slope_x, slope_y, near = x / z, y / z, torch.where(before, z, 1.0)
    jacobian = max(camera.fx, camera.fy) / near * (1 + slope_x**2 + slope_y**2).sqrt()
    reach = REACH * (parameters["log_scales"].detach().amax(dim=1).exp() * jacobian + WIDENED)
    u, v = camera.fx * slope_x + camera.cx, camera.fy * slope_y + camera.cy
    near_image = before & (u > -reach) & (u < camera.width + reach) & (v > -reach) & (v < camera.height + reach)
    rows = near_image.nonzero()[:, 0]
    shown = {name: value[rows] for name, value in parameters.items()}
    whole = finite_rows(shown)
    if whole.all():
        return rows, shown
    return rows[whole], {name: value[whole] for name, value in shown.items()}


def finite_rows(parameters: dict[str, Tensor]) -> Tensor:
    """Which Gaussians, bool [N], have no parameter that is NaN or infinite."""
    import torch

    # Zero times a number is NaN where it is not finite: a sixth of the time that testing every number takes.
    nothing = [(0 * v.detach()).reshape(len(v), math.prod(v.shape[1:])).sum(dim=1) for v in parameters.values()]
    return torch.isfinite(torch.stack(nothing).sum(dim=0))
