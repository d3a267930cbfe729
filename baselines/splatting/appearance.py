"""Gaussians whose colours in a view come from a network: the seam for methods that model appearance.

Each Gaussian carries `features` beside its usual parameters; they are cloned, split and pruned with it, and the trainer
optimises them. An `Appearance` makes one or several *looks* for a view of the Gaussians that it may show, each an
ordinary set of Gaussians that is rendered; gradients flow back through it. It is written in torch, so that the CPU's
kernels and gsplat both can stand at its end.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from baselines.splatting.constants import LOW_PASS
from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.splatting.rasterizer import Workspace
from baselines.splatting.torch_steps import finite_rows
from hydroviews.cameras import Camera

REACH = 3.5  # standard deviations within which a Gaussian is seen at all
WIDENED = LOW_PASS**0.5  # pixels of standard deviation that are at most added to every splat's


class Appearance(nn.Module):
    """Colours by view. A module whose own parameters `learn` steps; those of the Gaussians the trainer steps."""

    @abstractmethod
    def features(self, gaussians: Gaussians) -> NDArray[np.float32]:
        """The features [N, F] that Gaussians of the first hour start with."""

    @abstractmethod
    def looks(
        self, parameters: dict[str, Tensor], camera: Camera, view: int, degree: int
    ) -> tuple[dict[str, Tensor], ...]:
        """What Gaussians look like in a view.

        Args:
            parameters: of `Gaussians.arrays()`, of those `in_sight`; means are relative to the Gaussians' origin.
            camera: that looks; relative to that origin as well.
            view: index of the training view.
            degree: of spherical harmonics in use.

        Returns:
            Sets of parameters without features: first what the view shows, then what else the objective wants to
            compare. All have the means, quaternions, log-scales and opacity logits of the given ones.
        """

    @abstractmethod
    def learn(self, iteration: int) -> None:
        """A step of the network's own parameters, whose `.grad` is there; leaves them without gradients."""

    @abstractmethod
    def feature_rate(self, iteration: int) -> float:
        """Adam's learning rate of the features."""

    def about(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is refused."""
        return {"name": type(self).__name__}

    @abstractmethod
    def arrays(self) -> dict[str, NDArray]:
        """What has been learnt beside the Gaussians; see torch_state.module_arrays."""

    @abstractmethod
    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""


class Dressed:
    """The Gaussians in sight in numpy, their looks in numpy, and the way back for gradients to all Gaussians."""

    def __init__(self, gaussians: Gaussians, appearance: Appearance, camera: Camera, view: int, degree: int) -> None:
        self._total, self._origin = len(gaussians), gaussians.origin
        local = moved(camera, self._origin)
        rows, self._leaves = in_sight(tensors(gaussians), local)
        self.rows: NDArray[np.int64] = rows.numpy()  # of those in sight, ascending
        for leaf in self._leaves.values():
            leaf.requires_grad_()
        self._looks = appearance.looks(self._leaves, local, view, degree)
        self.looks = tuple(self._rendered(look) for look in self._looks)

    def backward(self, gradients: Sequence[Gaussians], workspace: Workspace) -> Gaussians:
        """From the gradients of a loss by the looks to those by all Gaussians; those of the network are in `.grad`.

        The arrays belong to the workspace and are overwritten by the next call.
        """
        tensors, upstream = [], []
        for look, gradient in zip(self._looks, gradients, strict=True):
            for name, value in gradient.arrays().items():
                if look[name].requires_grad:
                    tensors.append(look[name])
                    upstream.append(torch.from_numpy(value).reshape(look[name].shape))
        torch.autograd.backward(tensors, upstream)
        found = {
            name: self.spread(
                np.zeros(leaf.shape, np.float32) if leaf.grad is None else leaf.grad.numpy(), name, workspace
            )
            for name, leaf in self._leaves.items()
        }
        return Gaussians(**found, origin=self._origin)

    def spread(self, values: NDArray, name: str, workspace: Workspace, *, rest: int = 0) -> NDArray:
        """Values [n, ...] of those in sight among those of all Gaussians [N, ...], where the others have `rest`."""
        spread = workspace.array(f"all_{name}", (self._total, *values.shape[1:]), values.dtype)
        spread.fill(rest)
        spread[self.rows] = values
        return spread

    def _rendered(self, look: dict[str, Tensor]) -> Gaussians:
        return Gaussians(
            **{name: np.ascontiguousarray(look[name].detach().numpy(), np.float32) for name in FIELDS},
            origin=self._origin,
        )


def equipped(gaussians: Gaussians, appearance: Appearance | None) -> Gaussians:
    """Gaussians with the features that an appearance wants them to start with."""
    return gaussians if appearance is None else replace(gaussians, features=appearance.features(gaussians))


def dressed(gaussians: Gaussians, appearance: Appearance | None, camera: Camera, view: int, degree: int) -> Gaussians:
    """What a view shows of the Gaussians, those in sight; themselves, without an appearance."""
    if appearance is None:
        return gaussians
    with torch.no_grad():
        return Dressed(gaussians, appearance, camera, view, degree).looks[0]


def moved(camera: Camera, origin: NDArray[np.float64]) -> Camera:
    """The camera seen from another origin of the world."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] += pose[:3, :3] @ origin
    return replace(camera, world_to_camera=pose)


def tensors(gaussians: Gaussians, device: torch.device | None = None) -> dict[str, Tensor]:
    """The parameters on a device; on the CPU, which is the default, they share the Gaussians' memory."""
    return {name: torch.from_numpy(value).to(device) for name, value in gaussians.arrays().items()}


def in_sight(parameters: dict[str, Tensor], camera: Camera) -> tuple[Tensor, dict[str, Tensor]]:
    """The Gaussians that a camera may show: whole ones whose splats can touch the image.

    Generous, so that none that is shown is left out: a splat's standard deviation is at most the largest one of the
    Gaussian times the norm of the projection's Jacobian (Zwicker et al. 2002), and what renderers widen it by.

    Args:
        parameters: of all Gaussians.
        camera: that looks, relative to their origin.

    Returns:
        Their indices [n], ascending, and their parameters.
    """
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


def set_of(parameters: dict[str, Tensor], sh: Tensor) -> dict[str, Tensor]:
    """A look: the Gaussians with other coefficients [N, K, 3]."""
    return {**{name: parameters[name] for name in FIELDS}, "sh": sh}
