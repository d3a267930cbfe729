# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""A fixed budget of Gaussians as samples (Kheradmand et al. 2024, 3D Gaussian Splatting as Markov Chain Monte Carlo).

Dead Gaussians move to live ones, drawn in proportion to opacity; the number grows the same way up to the budget. Copies
share the opacity of their source so that the image hardly changes (equation 9). Noise after every step lets those that
are nearly transparent explore; penalties on opacity and size make superfluous ones die.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import prange
from numpy.typing import NDArray
from scipy.special import comb

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.geometry import exp64, rotation, sigmoid, unit_quaternion
from baselines.splatting.kernels.jit import exact_kernel
from baselines.splatting.schedule import Stream, random_stream
from baselines.splatting.state import TrainingState, opacities
from baselines.splatting.strategies.base import StepOptions, refinement_due
from baselines.splatting.strategies.densification import offsets

PAPER_EXTENT = 5.0  # of the paper's captures (Mip-NeRF 360 bonsai: 5.03); its noise and penalty have their lengths
GATE_STEEPNESS, GATE = 100.0, 0.995  # k and t: noise for a transparency above t, so for opacities below 0.005
MOST_COPIES = 51  # of one Gaussian in one refinement
HIGHEST_OPACITY = 1 - float(np.finfo(np.float32).eps)
FARTHEST = 1e30  # a move of this length comes from a broken Gaussian, which stays as it is
CHUNKS = 32


@dataclass(frozen=True)
class MCMCStrategy:
    """When and how; the defaults are the paper's, whose lengths are those of a scene of extent 5."""

    start: int = 500  # no refinement before
    stop: int = 25_000  # nor from here on
    every: int = 100  # iterations between two refinements
    budget: int = 1_000_000  # never more Gaussians than this
    growth: float = 0.05  # one refinement adds this share of the present number
    dead: float = 0.005  # highest opacity of those that are moved
    noise: float = 5e5  # of positions, in learning rates of the positions
    opacity_penalty: float = 0.01  # factor of the mean opacity in the loss
    scale_penalty: float = 0.01  # factor of the mean standard deviation
    spread: float = 0.0  # of copies around their source, in its standard deviations; the paper's stay where it is

    def step_options(self, iteration: int, means_lr: float, extent: float, seed: int) -> StepOptions:
        """See Strategy: penalties and noise in every step; the same scene in other units is trained the same way."""
        unit = extent / PAPER_EXTENT
        return StepOptions(
            opacity_penalty=self.opacity_penalty,
            scale_penalty=self.scale_penalty / unit,
            noise=self.noise * means_lr / unit**2,
            generator=random_stream(seed, Stream.NOISE, iteration),
        )

    def due(self, iteration: int) -> bool:
        """See Strategy."""
        return refinement_due(iteration, self.start, self.stop, self.every)

    def refine(self, state: TrainingState, extent: float, seed: int) -> TrainingState:
        """See Strategy: keep to the budget, move the dead, then grow."""
        generator = random_stream(seed, Stream.RELOCATION, state.iteration - 1)
        return grow(relocate(limit(state, self.budget), self, generator), self, generator)


def limit(state: TrainingState, budget: int) -> TrainingState:
    """Without the most transparent ones beyond the budget: a capture may start with more points than that."""
    surplus = len(state.gaussians) - budget
    if surplus <= 0:
        return state
    keep = np.ones(len(state.gaussians), np.bool_)
    keep[np.argsort(state.gaussians.opacity_logits, kind="stable")[:surplus]] = False
    return state.keep(keep)


def relocate(state: TrainingState, strategy: MCMCStrategy, generator: np.random.Generator) -> TrainingState:
    """Every dead Gaussian becomes a copy of a live one; moments of both start at zero."""
    opacity = opacities(state.gaussians)
    dead, live = np.flatnonzero(opacity <= strategy.dead), np.flatnonzero(opacity > strategy.dead)
    if not len(dead) or not len(live):
        return state
    sources = live[draw(opacity[live], len(dead), generator)]
    rows = np.arange(len(opacity))
    rows[dead] = sources
    return _copied(state, rows, sources, strategy, generator)


def grow(state: TrainingState, strategy: MCMCStrategy, generator: np.random.Generator) -> TrainingState:
    """More copies of live Gaussians, until the budget is reached."""
    n = len(state.gaussians)
    number = min(strategy.budget, int((1 + strategy.growth) * n)) - n
    opacity = opacities(state.gaussians)
    if number <= 0 or not opacity.sum() > 0:
        return state
    sources = draw(opacity, number, generator)
    return _copied(state, np.concatenate([np.arange(n), sources]), sources, strategy, generator)


def draw(weights: NDArray[np.float64], number: int, generator: np.random.Generator) -> NDArray[np.int64]:
    """Indices [number], with replacement, in proportion to weights [N] >= 0."""
    limits = np.cumsum(weights)
    return np.searchsorted(limits, generator.random(number) * limits[-1], side="right").clip(max=len(weights) - 1)


def shared(opacity: NDArray[np.float64], copies: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Opacity of each of N Gaussians in place of one, and the factor on its scales (equation 9).

    The double sum of the equation is sum_k C(N, k) (-1)^(k + 1) o_new^k / sqrt(k), by the hockey-stick identity.

    Args:
        opacity: of the one [M], in (0, 1).
        copies: N [M], from 1 to 51.
    """
    new = -np.expm1(np.log1p(-opacity) / copies)  # 1 - (1 - o)^(1 / N)
    k = np.arange(1, int(copies.max(initial=1)) + 1)
    terms = comb(copies[:, None], k) * np.where(k % 2, 1.0, -1.0) / np.sqrt(k) * new[:, None] ** k
    return new, opacity / terms.sum(axis=1)


def _copied(
    state: TrainingState,
    rows: NDArray[np.int64],
    sources: NDArray[np.int64],
    strategy: MCMCStrategy,
    generator: np.random.Generator,
) -> TrainingState:
    """The Gaussians `rows`, with opacity and size shared between each of `sources` and its copies."""
    counts = np.bincount(sources, minlength=len(state.gaussians))
    touched = (counts > 0)[rows]
    gaussians = state.gaussians.select(rows)
    copies = np.minimum(counts[rows][touched] + 1, MOST_COPIES)
    opacity, factor = shared(opacities(gaussians)[touched].clip(max=HIGHEST_OPACITY), copies)
    opacity = opacity.clip(strategy.dead, HIGHEST_OPACITY)
    gaussians.opacity_logits[touched] = np.log(opacity / (1 - opacity))
    gaussians.log_scales[touched] += np.log(factor)[:, None].astype(np.float32)
    if strategy.spread:
        moved = rows != np.arange(len(rows))
        gaussians.means[moved] += (strategy.spread * offsets(gaussians.select(moved), generator)).astype(np.float32)
    nothing = np.zeros((2, len(rows)), np.float32)
    return replace(
        state,
        gaussians=gaussians,
        first=_cleared(state.first.select(rows), touched),
        second=_cleared(state.second.select(rows), touched),
        gradient_sum=nothing[0],
        seen=nothing[1].copy(),
    )


def _cleared(moments: Gaussians, which: NDArray[np.bool_]) -> Gaussians:
    for value in moments.state_dict().values():
        value[which] = 0
    return moments


@exact_kernel
def _add_penalties(log_scales, opacity_logits, by_scale, by_opacity, g_log_scales, g_opacity_logits):
    n = opacity_logits.shape[0]
    for chunk in prange(CHUNKS):
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            opacity = sigmoid(np.float64(opacity_logits[i]))
            g_opacity_logits[i] += by_opacity * opacity * (1 - opacity)
            for k in range(3):
                g_log_scales[i, k] += by_scale * exp64(np.float64(log_scales[i, k]))


def add_penalties(gaussians: Gaussians, step_options: StepOptions, gradients: Gaussians) -> None:
    """Add the gradient of both penalties, in place."""
    n = max(len(gaussians), 1)
    weights = step_options.scale_penalty / (3 * n), step_options.opacity_penalty / n
    changed = gradients.log_scales, gradients.opacity_logits
    _add_penalties(gaussians.log_scales, gaussians.opacity_logits, *weights, *changed)


@exact_kernel
def _add_noise(means, quaternions, log_scales, opacity_logits, normal, factor):
    n = means.shape[0]
    for chunk in prange(CHUNKS):
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            transparency = 1 - sigmoid(np.float64(opacity_logits[i]))
            weight = factor * sigmoid(GATE_STEEPNESS * (transparency - GATE))
            qw, qx, qy, qz, _ = unit_quaternion(quaternions, i)
            r = rotation(qw, qx, qy, qz)
            n0, n1, n2 = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
            v0 = exp64(2 * np.float64(log_scales[i, 0])) * (r[0] * n0 + r[3] * n1 + r[6] * n2)
            v1 = exp64(2 * np.float64(log_scales[i, 1])) * (r[1] * n0 + r[4] * n1 + r[7] * n2)
            v2 = exp64(2 * np.float64(log_scales[i, 2])) * (r[2] * n0 + r[5] * n1 + r[8] * n2)
            if not weight * (abs(v0) + abs(v1) + abs(v2)) < FARTHEST:  # false for NaN
                continue
            means[i, 0] += weight * (r[0] * v0 + r[1] * v1 + r[2] * v2)
            means[i, 1] += weight * (r[3] * v0 + r[4] * v1 + r[5] * v2)
            means[i, 2] += weight * (r[6] * v0 + r[7] * v1 + r[8] * v2)


def add_noise(gaussians: Gaussians, step_options: StepOptions, normal: NDArray[np.float32]) -> None:
    """Move the positions in place by covariance times normal noise [N, 3], gated by opacity (equation 8).

    Args:
        gaussians: whose `means` change.
        duties: with the factor and the generator of the noise.
        normal: [N, 3], is overwritten.
    """
    assert step_options.generator is not None
    step_options.generator.standard_normal(out=normal, dtype=np.float32)
    _add_noise(*list(gaussians.state_dict().values())[:4], normal, float(step_options.noise))
