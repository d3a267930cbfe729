"""What a strategy asks of a step, in torch on any device: for the GPU, and as the yardstick of the kernels."""

import torch
from torch import Tensor

from baselines.splatting.reference import rotations
from baselines.splatting.relocation import GATE, GATE_STEEPNESS
from baselines.splatting.strategies import Duties


def penalty_gradient(name: str, values: Tensor, duties: Duties) -> Tensor | None:
    """The gradient of the penalty on the parameter `name` of values [N, ...]; None where there is none."""
    if name == "opacity_logits" and duties.opacity_penalty:
        opacity = values.sigmoid()
        return duties.opacity_penalty / max(opacity.numel(), 1) * opacity * (1 - opacity)
    if name == "log_scales" and duties.scale_penalty:
        return duties.scale_penalty / max(values.numel(), 1) * values.exp()
    return None


def noise(parameters: dict[str, Tensor], duties: Duties, normal: Tensor) -> Tensor:
    """What `relocation.add_noise` adds to the positions [N, 3] for normal noise [N, 3]."""
    transparency = 1 - parameters["opacity_logits"].sigmoid()
    weight = duties.noise * torch.sigmoid(GATE_STEEPNESS * (transparency - GATE))
    axes = rotations(parameters["quaternions"]) * parameters["log_scales"].exp()[:, None]
    return weight[:, None] * torch.einsum("nij,nkj,nk->ni", axes, axes, normal)


def drawn(duties: Duties, like: Tensor) -> Tensor:
    """Normal noise shaped like a tensor, on its device; the same for the same generator."""
    assert duties.generator is not None
    generator = torch.Generator(like.device).manual_seed(int(duties.generator.integers(2**62)))
    return torch.randn(like.shape, generator=generator, device=like.device, dtype=like.dtype)
