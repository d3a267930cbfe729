"""How long and with what steps Gaussians are trained, by profile: settings that splatting methods start from.

PROFILES                  plain splatting's
PROFILES_WITH_NETWORKS    for methods that train networks of their own
PROFILES_WITHOUT_RESETS   for methods that judge residuals
BUDGETED                  with half the Gaussians
"""

from dataclasses import replace

from baselines.splatting.config import Pruning, TrainerConfig
from baselines.splatting.schedule import LearningRates
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy

# Short runs: large steps that cool down at the end, the first third at half the size, no opacity resets, fast growth by
# absolute gradients up to a budget that two cores can afford; what is nearly transparent makes room. Growth alone takes
# too many of the steps of `demo` where a capture has few points.
# Chosen on clean views of courtyard, LLFF flower and Mip-NeRF 360 bonsai: docs/experiments/2026-11-faster-training.md
# has what was tried.
SHORT_RATES = LearningRates(
    means=5e-4,
    means_final=1e-5,
    sh=1.5e-2,
    sh_rest=7.5e-4,
    opacity=0.2,
    scales=2e-2,
    quaternions=8e-3,
    final=0.6,
    cooldown=0.15,
)
GROWTH = DefaultStrategy(growth=0.3, grow_grad2d=2e-4, absolute=True, reset_every=None, prune_scale3d=0.5)
SHORT = TrainerConfig(
    iterations=1600,
    sh_degree_interval=270,
    learning_rates=SHORT_RATES,
    near=0.05,
    strategy=replace(GROWTH, start=150, stop=1200, every=50, budget=30_000, prune_opacity=0.02),
    resolutions=((0.3, 2),),
)
PROFILES = {
    "demo": replace(SHORT, dense_start=0.5),
    "standard": replace(  # Gaussians and iterations chosen on LLFF flower alone
        SHORT,
        iterations=10_000,
        sh_degree_interval=1000,
        learning_rates=replace(SHORT_RATES, sh=1.125e-2, sh_rest=5.625e-4, opacity=0.15, quaternions=6e-3, final=0.3),
        strategy=replace(GROWTH, start=200, stop=7200, every=100, budget=200_000, prune_opacity=0.015),
    ),
    "paper": TrainerConfig(),
}
# For methods that train networks of their own, which want more lessons: with the steps of `demo` gs-w loses 0.5 dB.
# Their steps cost more, so that `standard` has fewer steps and Gaussians.
WITH_NETWORKS = TrainerConfig(
    iterations=3000,
    sh_degree_interval=500,
    learning_rates=LearningRates(sh=7.5e-3, sh_rest=3.75e-4, opacity=0.1, scales=2e-2, quaternions=4e-3, final=0.1),
    near=0.05,
    strategy=replace(GROWTH, start=300, stop=2200, every=100, budget=30_000),
)
PROFILES_WITH_NETWORKS = {
    "demo": WITH_NETWORKS,
    "standard": replace(
        WITH_NETWORKS,
        iterations=7000,
        sh_degree_interval=584,
        strategy=replace(WITH_NETWORKS.strategy, stop=5250, budget=100_000),
    ),
}


def with_iterations(iterations: int, profile: TrainerConfig) -> TrainerConfig:
    """A profile's training in another number of iterations, growing for the same share of them.

    For methods whose steps cost more, so that they stay within the same time.
    """
    strategy, share = profile.strategy, iterations / profile.iterations
    return replace(
        profile,
        iterations=iterations,
        sh_degree_interval=round(share * profile.sh_degree_interval),
        strategy=replace(strategy, stop=round(share * strategy.stop)),
    )


def pruned_to_budget(budget: int, profile: TrainerConfig) -> TrainerConfig:
    """A profile's training with fewer Gaussians: half as many again grow early, the least useful go before the middle.

    Twice the iterations, most of them with the Gaussians that stay, whose steps are cheaper. On so small a budget that
    beats relocation, which wants more iterations than short profiles have: docs/experiments/2026-11-splatting.md has
    the figures.
    """
    iterations = 2 * profile.iterations
    return replace(
        profile,
        iterations=iterations,
        strategy=replace(profile.strategy, stop=round(0.24 * iterations), budget=3 * budget // 2),
        pruning=Pruning(at=(0.25, 0.35, 0.45), budget=budget),
    )


def without_resets(splatting: TrainerConfig) -> TrainerConfig:
    """The same training without opacity resets, after which all residuals are large for a while."""
    assert isinstance(splatting.strategy, DefaultStrategy)
    return replace(splatting, strategy=replace(splatting.strategy, reset_every=None))


# The authors of RobustNeRF's filter, SpotLessSplats, DeSplat and NimbusGS reset none.
PROFILES_WITHOUT_RESETS = {name: without_resets(splatting) for name, splatting in PROFILES.items()}
BUDGETED = {
    "demo": pruned_to_budget(15_000, PROFILES["demo"]),
    "standard": pruned_to_budget(100_000, PROFILES["standard"]),
    "paper": replace(PROFILES["paper"], strategy=MCMCStrategy()),
}
