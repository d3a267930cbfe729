"""Parts of a step in torch on any device: what a strategy asks for, and non-finite Gaussians.

For the GPU; those of the strategy are the yardstick of the kernels as well.
"""

import math

import torch
from torch import Tensor

from baselines.splatting.backends.torch_rasterizer import rotations
from baselines.splatting.kernels.mcmc import FARTHEST, GATE, GATE_STEEPNESS
from baselines.splatting.strategies.base import PositionNoise, StepOptions


def penalty_gradient(name: str, values: Tensor, step_options: StepOptions) -> Tensor | None:
    """The gradient of the penalty on the parameter `name` of values [N, ...]; None where there is none."""
    if name == "opacity_logits" and step_options.opacity_penalty:
        opacity = values.sigmoid()
        return step_options.opacity_penalty / max(opacity.numel(), 1) * opacity * (1 - opacity)
    if name == "log_scales" and step_options.scale_penalty:
        return step_options.scale_penalty / max(values.numel(), 1) * values.exp()
    return None


def position_moves(parameters: dict[str, Tensor], noise: PositionNoise, normal: Tensor) -> Tensor:
    """What `relocation.add_noise` adds to the positions [N, 3] for normal noise [N, 3]."""
    transparency = 1 - parameters["opacity_logits"].sigmoid()
    weight = noise.factor * torch.sigmoid(GATE_STEEPNESS * (transparency - GATE))
    axes = rotations(parameters["quaternions"]) * parameters["log_scales"].exp()[:, None]
    moves = weight[:, None] * torch.einsum("nij,nkj,nk->ni", axes, axes, normal)
    return torch.where((moves.abs() < FARTHEST).all(dim=1, keepdim=True), moves, 0.0)


def normal_noise(noise: PositionNoise, like: Tensor) -> Tensor:
    """Normal noise shaped like a tensor, on its device; the same for the same generator."""
    generator = torch.Generator(like.device).manual_seed(int(noise.generator.integers(2**62)))
    return torch.randn(like.shape, generator=generator, device=like.device, dtype=like.dtype)


def finite_rows(parameters: dict[str, Tensor]) -> Tensor:
    """Which Gaussians, bool [N], have no parameter that is NaN or infinite."""
    # Zero times a number is NaN where it is not finite: a sixth of the time that testing every number takes.
    nothing = [(0 * v.detach()).reshape(len(v), math.prod(v.shape[1:])).sum(dim=1) for v in parameters.values()]
    return torch.isfinite(torch.stack(nothing).sum(dim=0))


def without_non_finite(parameters: dict[str, Tensor]) -> tuple[dict[str, Tensor], Tensor]:
    """Ones in place of the parameters of non-finite Gaussians, which so get no gradient; and which are finite [N]."""
    whole = finite_rows(parameters)
    if whole.all():
        return parameters, whole
    masks = {name: whole.reshape(-1, *[1] * (value.ndim - 1)) for name, value in parameters.items()}
    return {name: torch.where(masks[name], value, 1.0) for name, value in parameters.items()}, whole
