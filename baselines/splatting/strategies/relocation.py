"""A fixed budget of Gaussians as samples (Kheradmand et al. 2024, 3D Gaussian Splatting as Markov Chain Monte Carlo).

Dead Gaussians move to live ones, drawn in proportion to opacity; the number grows the same way up to the budget. Copies
share the opacity of their source so that the image hardly changes (equation 9). Noise after every step lets those that
are nearly transparent explore; penalties on opacity and size make superfluous ones die.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import SHAPE, Gaussians
from baselines.splatting.kernels.mcmc import move_by_noise, penalty_gradients
from baselines.splatting.rasterizer import ShapeGradients
from baselines.splatting.schedule import Stream, random_stream
from baselines.splatting.state import TrainingState, opacities
from baselines.splatting.strategies.base import PositionNoise, Refinement, StepOptions, refinement_due
from baselines.splatting.strategies.densification import offsets

PAPER_EXTENT = 5.0  # of the paper's captures (Mip-NeRF 360 bonsai: 5.03); its noise and penalty have their lengths
MOST_COPIES = 51  # of one Gaussian in one refinement
HIGHEST_OPACITY = 1 - float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class MCMCStrategy(Refinement):
    """When and how; the defaults are the paper's, whose lengths are those of a scene of extent 5.

    Gaussians start as for plain splatting; in the authors' code at an opacity of 0.5, not 0.1, and a tenth as large.
    """

    stop: int = 25_000  # iteration from which there is no refinement
    budget: int = 1_000_000  # largest number of Gaussians
    growth: float = 0.05  # share of the present number that one refinement adds
    dead: float = 0.005  # Gaussians with a smaller opacity are relocated
    noise: float = 5e5  # noise of the positions, in learning rates of the positions
    opacity_penalty: float = 0.01  # weight of the mean opacity in the loss
    scale_penalty: float = 0.01  # weight of the mean standard deviation in the loss
    spread: float = 0.0  # distance of copies from their source, in standard deviations of the source; 0 in the paper

    def step_options(self, iteration: int, means_lr: float, extent: float, seed: int) -> StepOptions:
        """See Strategy: penalties and noise in every step; the same scene in other units is trained the same way."""
        unit = extent / PAPER_EXTENT
        factor = self.noise * means_lr / unit**2
        return StepOptions(
            opacity_penalty=self.opacity_penalty,
            scale_penalty=self.scale_penalty / unit,
            noise=PositionNoise(factor, random_stream(seed, Stream.NOISE, iteration)) if factor else None,
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
    from scipy.special import comb

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


def add_penalties(gaussians: Gaussians, step_options: StepOptions, gradients: Gaussians | ShapeGradients) -> None:
    """Add the gradient of both penalties, in place."""
    n = max(len(gaussians), 1)
    weights = step_options.scale_penalty / (3 * n), step_options.opacity_penalty / n
    changed = gradients.log_scales, gradients.opacity_logits
    penalty_gradients(gaussians.log_scales, gaussians.opacity_logits, *weights, *changed)


def add_noise(gaussians: Gaussians, noise: PositionNoise, normal: NDArray[np.float32]) -> None:
    """Move the positions in place by covariance times normal noise [N, 3], gated by opacity (equation 8).

    Args:
        gaussians: whose `means` change.
        noise: its factor and generator.
        normal: [N, 3], is overwritten.
    """
    noise.generator.standard_normal(out=normal, dtype=np.float32)
    move_by_noise(*(getattr(gaussians, name) for name in SHAPE), normal, float(noise.factor))
