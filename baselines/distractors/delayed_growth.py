"""Any method of Gaussians, growing late (RobustSplat, Fu et al. 2025, section 3.1): `spotless+delayed-growth`.

Gaussians that are added early fit distractors before masks know them. With those of the scene's points alone, the scene
is learned first; growth begins after a third of the iterations and ends after two thirds, as the authors', or when it
would have ended anyway if that is later. Theirs holds opacity resets back as well; here they stay as they are.
"""

from dataclasses import replace
from functools import cache
from typing import Any

from baselines.method import Method, named
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from hydroviews.errors import InputError

FIRST, LAST = 1 / 3, 2 / 3  # shares of the iterations, between which Gaussians are added


@cache
def with_delayed_growth(method: type[Method]) -> type[Method]:
    """The same method with settings that let Gaussians grow late."""

    class Delayed(method):  # type: ignore[misc, valid-type]
        @classmethod
        def configuration(cls, profile: str) -> Any:
            """See Method.

            Raises:
                InputError: no such profile, or nothing that grows.
            """
            return delayed(super().configuration(profile), method.__name__)

    return named(Delayed, f"{method.__name__}DelayedGrowth", f"{method.__name__} with growth delayed.")


def delayed(config: Any, name: str) -> Any:
    """Settings with late growth: a TrainerConfig's, or those that hold one as `splatting`, or as a wrapped `method`.

    Args:
        config: the settings.
        name: of the method, for errors.

    Raises:
        InputError: there is no adaptive density control to delay, or its budget is kept by pruning.
    """
    for part in ("splatting", "method"):
        inside = getattr(config, part, None)
        if inside is not None:
            return replace(config, **{part: delayed(inside, name)})
    if not isinstance(config, TrainerConfig) or not isinstance(config.strategy, DefaultStrategy):
        raise InputError(f"{name}: no growth to delay", expected="a method with adaptive density control")
    if config.pruning is not None and config.pruning.budget is not None:
        raise InputError(
            f"{name}: a budget that is kept by pruning",
            found="Gaussians that still grow after the last pruning",
            expected="a method without `pruning.budget`",
        )
    strategy = config.strategy
    first, last = (round(share * config.iterations) for share in (FIRST, LAST))
    strategy = replace(strategy, start=first, stop=max(last, strategy.stop))
    return replace(config, strategy=strategy, dense_start=0.0)
