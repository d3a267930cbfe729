"""What the methods of this folder have in common: no opacity resets."""

from dataclasses import replace

from baselines.gaussian_splatting import PROFILES
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy


def without_resets(splatting: TrainerConfig) -> TrainerConfig:
    """The same training without opacity resets, after which all residuals are large for a while."""
    assert isinstance(splatting.strategy, DefaultStrategy)
    return replace(splatting, strategy=replace(splatting.strategy, reset_every=None))


# Plain splatting's; the authors of these methods reset no opacities.
SPLATTING = {name: without_resets(splatting) for name, splatting in PROFILES.items()}
