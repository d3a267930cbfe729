"""Parts of a step in torch on any device: the loss, Adam, what a strategy asks for, and non-finite Gaussians.

For the GPU, where `triton_ops` has loss and Adam faster; the strategy's parts are the yardstick of the kernels, too.
"""

import torch
from torch import Tensor

from baselines.splatting.appearance.gaussians import finite_rows
from baselines.splatting.backends import torch_rasterizer
from baselines.splatting.backends.torch_rasterizer import rotations
from baselines.splatting.kernels.adam import BETA1, BETA2, EPSILON
from baselines.splatting.kernels.mcmc import FARTHEST, GATE, GATE_STEEPNESS
from baselines.splatting.strategies.base import PositionNoise, StepOptions


def photometric_loss(
    image: Tensor, target: Tensor, lambda_dssim: float, shown: Tensor | None, weights: Tensor | None
) -> tuple[Tensor, Tensor]:
    """The photometric loss (see `photometric`) and its gradient by the image.

    Args:
        image: rendered, float32 [H, W, 3].
        target: what it should look like, uint8 [H, W, 3].
        lambda_dssim: lambda in (1 - lambda) L1 + lambda (1 - SSIM).
        shown: bool [H, W], false where pixels are hidden; None where none is.
        weights: float32 [H, W], factors from 0 on, on each pixel's share of the loss and of SSIM's windows; None where
            all are 1.
    """
    leaf = image.detach().requires_grad_()
    with torch.enable_grad():
        loss = torch_rasterizer.photometric_loss(leaf, target / 255, lambda_dssim, shown, weights)
    (gradient,) = torch.autograd.grad(loss, leaf)
    return loss.detach(), gradient


def adam_step(
    values: Tensor, gradient: Tensor, first: Tensor, second: Tensor, rates: Tensor, step: int, broken: Tensor
) -> None:
    """One step of Adam (see `kernels.adam`), in place.

    Args:
        values: [N, ...], float32 as all of them.
        gradient: of the loss by them.
        first: their first moments.
        second: their second moments.
        rates: as many as there are numbers in a row of the values, or one for all.
        step: from 1.
        broken: int32 [1], becomes 1 where a value is no longer finite.
    """
    first.mul_(BETA1).add_(gradient, alpha=1 - BETA1)
    second.mul_(BETA2).addcmul_(gradient, gradient, value=1 - BETA2)
    move = first / (second.sqrt() / (1 - BETA2**step) ** 0.5 + EPSILON)
    values -= rates.view(values.shape[1:] if rates.numel() > 1 else ()) / (1 - BETA1**step) * move
    broken |= ~torch.isfinite((0 * values).sum())  # zero times a number is NaN where it is not finite


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


def without_non_finite(parameters: dict[str, Tensor]) -> tuple[dict[str, Tensor], Tensor]:
    """Ones in place of the parameters of non-finite Gaussians, which so get no gradient; and which are finite [N]."""
    whole = finite_rows(parameters)
    if whole.all():
        return parameters, whole
    masks = {name: whole.reshape(-1, *[1] * (value.ndim - 1)) for name, value in parameters.items()}
    return {name: torch.where(masks[name], value, 1.0) for name, value in parameters.items()}, whole
