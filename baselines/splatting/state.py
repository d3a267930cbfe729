"""What training changes, and how Gaussians come and go with their moments."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import Gaussians, join

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainingState:
    """Everything that a step of training changes; a checkpoint is this and nothing else."""

    gaussians: Gaussians
    first: Gaussians  # Adam's first moments
    second: Gaussians  # and second
    gradient_sum: NDArray[np.float32]  # [N], norms of the position gradient since the last refinement
    seen: NDArray[np.float32]  # [N], views that showed the Gaussian since then
    iteration: int = 0  # steps done
    seconds: float = 0.0  # time spent on them, over all sessions
    residuals: tuple[float, ...] = ()  # mean losses of the validation views, one a validation
    non_finite: int = 0  # Gaussians removed so far because a parameter was not finite

    def keep(self, which: NDArray[np.bool_]) -> "TrainingState":
        """Only those Gaussians that a mask [N] picks, with all that is known of them."""
        parts = {name: getattr(self, name).select(which) for name in ("gaussians", "first", "second")}
        return replace(self, **parts, gradient_sum=self.gradient_sum[which], seen=self.seen[which])

    def refined(self, keep: NDArray[np.bool_], added: Gaussians) -> "TrainingState":
        """Those that the mask `keep` [N] picks, then new ones with zero moments; all statistics at zero."""
        rows, none = np.flatnonzero(keep), added.zeros()
        total = len(rows) + len(added)
        return replace(
            self,
            gaussians=join(self.gaussians, rows, added),
            first=join(self.first, rows, none),
            second=join(self.second, rows, none),
            gradient_sum=np.zeros(total, np.float32),
            seen=np.zeros(total, np.float32),
        )


def fresh_state(gaussians: Gaussians) -> TrainingState:
    """The state before the first step."""
    n = len(gaussians)
    nothing = np.zeros((2, n), np.float32)
    return TrainingState(gaussians, gaussians.zeros(), gaussians.zeros(), nothing[0].copy(), nothing[1].copy())


def finite(gaussians: Gaussians) -> NDArray[np.bool_]:
    """Which Gaussians [N] have no parameter that is NaN or infinite."""
    checks = [np.isfinite(v).all(axis=tuple(range(1, v.ndim))) for v in gaussians.state_dict().values()]
    return np.logical_and.reduce(checks)


def without_non_finite(state: TrainingState) -> TrainingState:
    """Only the Gaussians whose parameters are all finite; logs a warning, the first time, of what was removed.

    Until then they are harmless: no renderer shows them, so their gradients are zero.
    """
    whole = finite(state.gaussians)
    count = int((~whole).sum())
    if not count:
        return state
    if not state.non_finite:
        bad = {
            name: int((~np.isfinite(v)).reshape(len(v), -1).any(axis=1).sum())
            for name, v in state.gaussians.state_dict().items()
        }
        where = ", ".join(f"{name} of {number}" for name, number in bad.items() if number)
        logger.warning(
            "training: %d of %d Gaussians are removed after iteration %d, as they are NaN or infinite: %s. "
            "Later ones are only counted.",
            count,
            len(whole),
            state.iteration,
            where,
        )
    return replace(state.keep(whole), non_finite=state.non_finite + count)


def opacities(gaussians: Gaussians) -> NDArray[np.float64]:
    """Opacities [N] in [0, 1]."""
    with np.errstate(over="ignore"):  # exp of a large number is infinite, and its opacity zero
        return 1 / (1 + np.exp(-gaussians.opacity_logits.astype(np.float64)))
