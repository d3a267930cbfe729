"""Depths of what is along a ray, from the camera and from behind.

Both are depths of normalised device coordinates, t in [0, 1]. The contracted space has none; there they are what such
coordinates have where their near plane is its own: 1 - near / t. Near things are spread out in it, and infinity is at
1. An occluder far before the scene has a small depth and a depth from behind that is the scene's; where there is one
surface the two agree.
"""

import torch
from torch import Tensor

from baselines.volumetric.rays.spaces import Contracted, Space


def middles(edges: Tensor, space: Space, open_end: bool) -> Tensor:
    """Depths [R, S] of intervals between edges [R, S + 1] in [0, 1]; one that reaches to infinity is at 1."""
    t = space.s_to_t((edges[:, 1:] + edges[:, :-1]) / 2)
    inner = 1 - space.near / t if isinstance(space, Contracted) else t
    return torch.cat([inner[:, :-1], torch.ones_like(inner[:, :1])], 1) if open_end else inner


def depth(weights: Tensor, positions: Tensor) -> Tensor:
    """Mean depth [R] of what is seen: weights and positions [R, S]; what light is left comes from 1."""
    return 1 + (weights * (positions - 1)).sum(1)


def depth_from_behind(density: Tensor, lengths: Tensor, positions: Tensor, open_end: bool) -> Tensor:
    """Mean depth [R] of what would be seen by looking back from infinity: the last surface of the ray.

    The alphas are those of the view from the camera, in reversed order. An interval that reaches to infinity is left
    out: it is opaque whatever its density is, as nothing can be behind it, and would hide all the others. Light that
    nothing stops counts as coming from 1, as it does in `depth`: an empty ray has no gap.

    Args:
        density: sigma [R, S], not negative.
        lengths: delta [R, S].
        positions: depths [R, S], see `middles`.
        open_end: whether the last interval reaches to infinity.
    """
    thickness = density * lengths
    if open_end:
        thickness = torch.cat([thickness[:, :-1], torch.zeros_like(thickness[:, :1])], 1)
    # Sums behind each interval; subtracting its own from a sum with it would leave nothing behind opaque ones.
    behind = torch.cumsum(thickness[:, 1:].flip(1), 1).flip(1)
    behind = torch.cat([behind, torch.zeros_like(thickness[:, :1])], 1)
    return depth(torch.exp(-behind) * -torch.expm1(-thickness), positions)
