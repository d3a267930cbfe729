"""From densities along rays to weights and colours, in log space: nothing over- or underflows on the way."""

import torch
from torch import Tensor

INFINITE = 1e10  # length of an interval that reaches to infinity (NeRF)


def compositing_weights(density: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """What every interval contributes to its ray, w = T (1 - exp(-sigma delta)), and what light is left behind all.

    Exact on empty rays (all weights zero) and on saturated ones (they sum up to one).

    Args:
        density: sigma [R, S], not negative.
        lengths: delta [R, S].

    Returns:
        Weights [R, S], and transmittance [R] behind the last interval.
    """
    thickness = density * lengths
    # Sums before each interval; subtracting the last, infinite, one from a sum of all would leave nothing of it.
    before = torch.cumsum(thickness[:, :-1], 1)
    before = torch.cat([torch.zeros_like(thickness[:, :1]), before], 1)
    weights = torch.exp(-before) * -torch.expm1(-thickness)
    return weights, torch.exp(-before[:, -1] - thickness[:, -1])


def interval_lengths(t: Tensor, directions: Tensor, open_end: bool) -> Tensor:
    """Lengths [R, S] between edges t [R, S + 1] of rays with directions [R, 3]; the last is infinite if so wished."""
    lengths = t.diff(dim=1) * directions.norm(dim=1, keepdim=True)
    if open_end:
        lengths = torch.cat([lengths[:, :-1], torch.full_like(lengths[:, :1], INFINITE)], 1)
    return lengths


def along_ray(weights: Tensor, values: Tensor) -> Tensor:
    """Weighted sums [R, C] of values [R, S, C] with weights [R, S]."""
    return torch.einsum("rs,rsc->rc", weights, values)
