"""Whether there is a medium: two short trainings, with one and without, judged by views that neither learns from.

A medium can always trade with the colours of the scene: haze over a scene that is darker by as much looks the same from
most cameras, and the dark channel asks for it. But it lies in space, and says how views look that it was not learned
from: where it is real, it matches these better.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from baselines.nimbus.config import NimbusConfig
from baselines.nimbus.objective import NimbusObjective
from baselines.splatting.config import EarlyStop, TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.trainer import train
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)
HELD_BACK = 8  # one of so many views
HALF = ((1.0, 2),)  # all of the trial at half the size
Objectives = Callable[[NimbusConfig, bool], NimbusObjective]  # of settings, and whether there is a medium


@dataclass(frozen=True)
class Trial:
    """What the two trainings said."""

    with_medium: float  # mean loss of the views held back
    without: float
    seconds: float  # of both

    def kept(self, margin: float) -> bool:
        """Whether the medium lowers the loss by the margin, a share of it."""
        return self.with_medium <= (1 - margin) * self.without


def hold_trial(scene: Scene, config: NimbusConfig, seed: int, folder: Path, objectives: Objectives) -> Trial | None:
    """Train twice, or take what earlier sessions left in `folder`; None where too few views could be held back.

    Raises:
        See `train`.
    """
    n_views = len(scene.train_views)
    if n_views < 2:
        logger.info("nimbus: no medium, as one view cannot tell it from the scene")
        return None
    short = shortened(config, max(1, n_views // HELD_BACK))
    losses: dict[str, float] = {}
    seconds = 0.0
    for name, used in (("with-medium", True), ("without-medium", False)):
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        trained = train(scene, short.splatting, seed, place, objectives(short, used))
        losses[name] = trained.residuals[-1]
        seconds += trained.seconds
    return Trial(losses["with-medium"], losses["without-medium"], seconds)


def shortened(config: NimbusConfig, held_back: int) -> NimbusConfig:
    """Settings of the trial: fewer iterations, smaller pictures, and so many views that are not learned from."""
    splatting, share = config.splatting, config.medium.trial
    iterations = max(1, round(share * splatting.iterations))
    short: TrainerConfig = replace(
        splatting,
        iterations=iterations,
        sh_degree_interval=max(1, round(share * splatting.sh_degree_interval)),
        strategy=_earlier(splatting, share),
        resolutions=HALF,
        pruning=None,
        early_stop=EarlyStop(views=held_back, every=iterations),
    )
    return replace(config, splatting=short, residual=replace(config.residual, used=False))


def _earlier(splatting: TrainerConfig, share: float) -> DefaultStrategy:
    strategy = splatting.strategy
    assert isinstance(strategy, DefaultStrategy)
    return replace(strategy, start=round(share * strategy.start), stop=round(share * strategy.stop))
