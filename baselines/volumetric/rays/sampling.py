"""Where along rays to sample: stratified intervals, their refinement by inverse-CDF sampling, and losses on histograms.

Edges s [R, S + 1] rise from 0 to 1; weights [R, S] belong to the intervals between them.
"""

import torch
from torch import Tensor

PADDING = 0.01  # of all weight, spread evenly, so that every part of a ray is sampled now and then (Mip-NeRF 360)
BIAS = 10.0  # of `annealed`: how early the exponent rises; the paper's


def even_edges(rays: int, samples: int, jitter: Tensor | None, device: torch.device) -> Tensor:
    """Edges of intervals of one length; the inner ones are moved together by a jitter [R] in [0, 1)."""
    return _positions(rays, samples, jitter, device)


def resample(edges: Tensor, weights: Tensor, samples: int, jitter: Tensor | None, sharpness: float = 1.0) -> Tensor:
    """Edges of intervals that each hold the same part of a histogram.

    Args:
        edges: of the histogram [R, S + 1].
        weights: [R, S], not negative; they need not sum up to one.
        samples: how many intervals are wanted.
        jitter: one number [R] in [0, 1) that moves all inner edges of a ray; None for none.
        sharpness: exponent of the weights, below one early in a training (Mip-NeRF 360, equation 18).

    Returns:
        Edges [R, samples + 1] from 0 to 1.
    """
    sharpened = weights**sharpness if sharpness != 1 else weights
    total = sharpened.sum(1, keepdim=True)
    even = torch.full_like(sharpened, 1 / sharpened.shape[1])
    shares = torch.where(total > 1e-8, sharpened / total.clamp_min(1e-8), even)
    shares = (shares + PADDING * even) / (1 + PADDING)
    cumulative = torch.cat([torch.zeros_like(shares[:, :1]), shares.cumsum(1)], 1)
    cumulative = cumulative / cumulative[:, -1:]
    wanted = _positions(len(edges), samples, jitter, edges.device)
    right = torch.searchsorted(cumulative, wanted, right=True).clamp(1, shares.shape[1])
    low, high = cumulative.gather(1, right - 1), cumulative.gather(1, right)
    start, end = edges.gather(1, right - 1), edges.gather(1, right)
    within = ((wanted - low) / (high - low).clamp_min(1e-12)).clamp(0, 1)
    return start + within * (end - start)


def _positions(rays: int, samples: int, jitter: Tensor | None, device: torch.device) -> Tensor:
    """0, 1 and, between them, positions 1 / samples apart [R, samples + 1]."""
    steps = torch.arange(samples + 1, device=device, dtype=torch.float32).expand(rays, -1)
    if jitter is None:
        return steps / samples
    moved = (steps + (jitter[:, None] - 0.5)) / samples
    return torch.cat([torch.zeros_like(moved[:, :1]), moved[:, 1:-1], torch.ones_like(moved[:, :1])], 1)


def annealed(iteration: int, iterations: int) -> float:
    """Exponent of the proposals' weights: rises from 0 to 1 (Mip-NeRF 360, equation 18)."""
    share = min(1.0, iteration / iterations) if iterations else 1.0
    return BIAS * share / ((BIAS - 1) * share + 1)


def interlevel_loss(edges: Tensor, weights: Tensor, proposal_edges: Tensor, proposal_weights: Tensor) -> Tensor:
    """How far the proposal's histogram fails to bound the field's from above [R] (Mip-NeRF 360, equation 13).

    Only the proposal gets a gradient: `weights` count as constants.
    """
    edges, weights = edges.detach(), weights.detach()
    cumulative = torch.cat([torch.zeros_like(proposal_weights[:, :1]), proposal_weights.cumsum(1)], 1)
    proposal_edges, last = proposal_edges.contiguous(), proposal_weights.shape[1]
    first = (torch.searchsorted(proposal_edges, edges[:, :-1].contiguous(), right=True) - 1).clamp(0, last)
    behind = torch.searchsorted(proposal_edges, edges[:, 1:].contiguous(), right=False).clamp(0, last)
    bound = cumulative.gather(1, behind) - cumulative.gather(1, first)
    return ((weights - bound).clamp_min(0) ** 2 / (weights + 1e-7)).sum(1)


def distortion_loss(edges: Tensor, weights: Tensor) -> Tensor:
    """How scattered weights are along their ray [R] (Mip-NeRF 360, equation 15), in linear time."""
    middles, lengths = (edges[:, 1:] + edges[:, :-1]) / 2, edges.diff(dim=1)
    before = weights.cumsum(1) - weights
    moment = weights * middles
    between = 2 * (weights * (middles * before - (moment.cumsum(1) - moment))).sum(1)
    return between + (weights**2 * lengths).sum(1) / 3
