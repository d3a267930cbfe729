"""How NimbusGS' medium and residuals are trained."""

from dataclasses import dataclass, field

from baselines.splatting.config import TrainerConfig


@dataclass(frozen=True)
class MediumConfig:
    """Settings of the medium; the defaults are those of the profile `paper`.

    Of the paper: cells, spread, box, samples, rate, the weight of the variation. The others are ours; that of the dark
    channel, too, which is 1 there, in a scale that is not public: where it is above 0.01 here, scenes become too dark.

    Attributes:
        used: whether there is a medium at all.
        cells: number of grid cells per axis, at least 2.
        spread: standard deviation of the field at the start.
        clear: optical depth at the start, positive, over the median distance from a camera to a scene point: 0.05 is
            nearly clear air.
        box: side of the grid's box, in extents of the points without their outermost hundredths; positive.
        samples: number of samples per ray, at least 1.
        ray_shrink: rays are cast through a picture this many times smaller, from 1; the medium is smooth.
        first: share of the iterations after which there is a medium, [0, 1].
        renewed: iterations between two renders of a view's depth, at least 1.
        rate: learning rate of all parameters of the medium, positive.
        variation: weight of the grid's total variation, at least 0.
        dark: weight of the scene's dark channel, at least 0.
        patch: side of the dark channel's patches, in longer sides of the picture, in (0, 1]: 15 pixels of 600.
        judged: share of the iterations after which the medium is given up if it takes too little light, [0, 1].
        least: share of the light, mean over all views, that it has to take by then, from 0; 0: it is never given up.
    """

    used: bool = True
    cells: int = 128
    spread: float = 0.01
    clear: float = 0.05
    box: float = 2.0
    samples: int = 32
    ray_shrink: int = 4
    first: float = 1 / 15
    renewed: int = 300
    rate: float = 0.005
    variation: float = 1.0
    dark: float = 0.01
    patch: float = 1 / 40
    judged: float = 0.4
    least: float = 0.07

    def __post_init__(self) -> None:
        if self.cells < 2 or min(self.samples, self.ray_shrink, self.renewed) < 1:
            raise ValueError(f"{self}: expected cells from 2; samples, ray_shrink and renewed from 1")
        weights = self.spread, self.variation, self.dark, self.least
        if min(self.clear, self.box, self.rate, self.patch) <= 0 or min(weights) < 0:
            raise ValueError(f"{self}: expected clear, box, rate and patch above 0; spread, least and weights from 0")
        if not (0 <= self.first <= self.judged <= 1 and self.patch <= 1):
            raise ValueError(f"{self}: expected first up to judged, judged and patch up to 1")


@dataclass(frozen=True)
class ResidualConfig:
    """Settings of the residuals; the defaults are those of the profile `paper`.

    They are the paper's but for `signed` and `most`, which are ours.

    Attributes:
        used: whether there are residuals at all.
        threshold: mean difference over the channels above which a pixel becomes a residual; encoded values, positive.
        signed: whether residuals may also be darker than the scene.
        first: share of the iterations without residuals, [0, 1].
        every: share of the iterations after which a view's residual is made anew, at its next visit.
        most: share of all pixels with residuals above which a warning is logged.
    """

    used: bool = True
    threshold: float = 0.05
    signed: bool = False
    first: float = 4000 / 30_000
    every: float = 100 / 30_000
    most: float = 0.5

    def __post_init__(self) -> None:
        if self.threshold <= 0 or not (0 <= self.first <= 1 and 0 <= self.every <= 1 and 0 < self.most <= 1):
            raise ValueError(f"{self}: expected a threshold above 0; shares up to 1")


@dataclass(frozen=True)
class NimbusConfig:
    """Gaussians, and what lies before them."""

    splatting: TrainerConfig = field(default_factory=TrainerConfig)
    medium: MediumConfig = field(default_factory=MediumConfig)
    residual: ResidualConfig = field(default_factory=ResidualConfig)
