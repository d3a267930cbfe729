"""How NimbusGS' medium and residuals are trained."""

from dataclasses import dataclass, field

from baselines.splatting.config import TrainerConfig


@dataclass(frozen=True)
class MediumConfig:
    """Settings of the medium; the defaults are those of the profile `paper`.

    Of the paper: cells, rate, the weight of the variation. The others are ours; that of the dark
    channel, too, which is 1 there, in a scale that is not public: where it is above 0.01 here, scenes become too dark.

    Attributes:
        cells: number of grid cells per axis, at least 2.
        ray_shrink: rays are cast through a picture this many times smaller, from 1; the medium is smooth.
        first: share of the iterations after which there is a medium, [0, 1].
        renewed: iterations between two renders of a view's depth, at least 1.
        rate: learning rate of all parameters of the medium, positive.
        variation: weight of the grid's total variation, at least 0.
        dark: weight of the scene's dark channel, at least 0.
        judged: share of the iterations after which the medium is given up if it takes too little light, [0, 1].
        least: share of the light, mean over all views, that it has to take by then, from 0; 0: it is never given up.
    """

    cells: int = 128
    ray_shrink: int = 4
    first: float = 1 / 15
    renewed: int = 300
    rate: float = 0.005
    variation: float = 1.0
    dark: float = 0.01
    judged: float = 0.4
    least: float = 0.07

    def __post_init__(self) -> None:
        if self.cells < 2 or min(self.ray_shrink, self.renewed) < 1:
            raise ValueError(f"{self}: expected cells from 2; ray_shrink and renewed from 1")
        if self.rate <= 0 or min(self.variation, self.dark, self.least) < 0:
            raise ValueError(f"{self}: expected a rate above 0; least and weights from 0")
        if not 0 <= self.first <= self.judged <= 1:
            raise ValueError(f"{self}: expected first up to judged, judged up to 1")


@dataclass(frozen=True)
class ResidualConfig:
    """Settings of the residuals; the defaults are those of the profile `paper`.

    They are the paper's. A residual is never darker than the scene.

    Attributes:
        threshold: mean difference over the channels above which a pixel becomes a residual; encoded values, positive.
        first: share of the iterations without residuals, [0, 1].
        every: share of the iterations after which a view's residual is made anew, at its next visit.
    """

    threshold: float = 0.05
    first: float = 4000 / 30_000
    every: float = 100 / 30_000

    def __post_init__(self) -> None:
        if self.threshold <= 0 or not (0 <= self.first <= 1 and 0 <= self.every <= 1):
            raise ValueError(f"{self}: expected a threshold above 0; shares up to 1")


@dataclass(frozen=True)
class NimbusConfig:
    """Gaussians, and what lies before them; None leaves a part out."""

    splatting: TrainerConfig = field(default_factory=TrainerConfig)
    medium: MediumConfig | None = field(default_factory=MediumConfig)
    residual: ResidualConfig | None = field(default_factory=ResidualConfig)
