"""Settings of the rain model. Numbers without a source were chosen on the three development scenes
(docs/experiments/2026-11-rain-model.md)."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class MistConfig:
    """Mist on the lens.

    Attributes:
        rate: of Adam for sqrt(mist_alpha), positive.
        colour_rate: of Adam for the mist's light, positive; linear light a step.
        prior: factor in the loss of the mean squared distance of mist_alpha to its prior, in standard deviations.
        roughness: factor of the mean squared difference of neighbouring knots, in sqrt(mist_alpha), from 0.
        brightness: factor of the squared distance of the mist's light to what is expected of it, from 0, in the mean
            of the channels: lighter mist is as good as more of it.
        tint: the same of how far each channel is from that mean: dark things show the tint. With 0.1 flower's heavy
            drops have 26.0 dB, with 0.001 to 0.01 26.4 to 26.6.
        slack: factor, at least 1, by which mist_alpha may exceed the most that the photographs allow: that most is a
            quantile.
    """

    rate: float = 1e-2
    colour_rate: float = 1e-3
    prior: float = 3e-4
    roughness: float = 0.01
    brightness: float = 0.1
    tint: float = 0.003
    slack: float = 1.3


@dataclass(frozen=True)
class DropsConfig:
    """Drops on the lens that stay, as lines in which photographs follow renders.

    Attributes:
        long_side: pixels, at least 1, of the planes in which drops are looked for.
        every: iterations, at least 1, to a view that is added to the sums. They remember as many views either way; with
            2 an objective's step takes a twentieth less than with 1.
        noise: standard deviation of renders, encoded, positive; where they vary less, slopes are drawn to one.
        usual: excess of the fixed pattern over chance, from 1, up to which a place shows no drop.
        fixed: the same, above `usual`, from which it surely does.
    """

    long_side: int = 400
    every: int = 2
    noise: float = 0.04
    usual: float = 1.3
    fixed: float = 1.8


@dataclass(frozen=True)
class OcclusionConfig:
    """What drops hide of each view, as a network predicts it.

    Attributes:
        pseudo_views: views that the network's prediction counts for beside the lines of the drops.
        cost: of learning a drop, in units of the cost of leaving a pixel out, positive.
    """

    pseudo_views: float = 24.0
    cost: float = 4.0


@dataclass(frozen=True)
class RainfallConfig:
    """Falling rain, as a network predicts it.

    Attributes:
        brightness: beta, the encoded value of streaks, (0, 1]. It cannot be told from the photographs; an error of 0.1
            changes the scene by 0.1 S.
    """

    brightness: float = 0.88


@dataclass(frozen=True)
class RainConfig:
    """Which kinds of rain are modelled; None leaves one out.

    Attributes:
        mist: on the lens.
        drops: on the lens, where they stay.
        occlusion: what drops hide of each view, staying or not; only where a network predicts covers.
        rainfall: falling rain; only where a network predicts it.
        enhanced: share of the iterations, [0, 1], up to which the scene is learned from enhanced photographs as well,
            less and less; 0 for never.
        start: share of the iterations, [0, 1), before drops are looked for.
        trial: share of the iterations, (start, 1), up to which single views are kept from the scene, to predict them
            with each layer and without it.
    """

    mist: MistConfig | None = field(default_factory=MistConfig)
    drops: DropsConfig | None = field(default_factory=DropsConfig)
    occlusion: OcclusionConfig | None = field(default_factory=OcclusionConfig)
    rainfall: RainfallConfig | None = field(default_factory=RainfallConfig)
    enhanced: float = 0.6
    start: float = 0.05
    trial: float = 0.2
