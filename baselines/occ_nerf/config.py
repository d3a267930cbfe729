"""How Occlusion-free NeRF is rendered and trained."""

from dataclasses import dataclass, field

from baselines.volumetric.config import HashFieldConfig, MlpFieldConfig, VolumetricConfig


@dataclass(frozen=True)
class OccNerfConfig:
    """Two fields, the detector, and the weights of the losses.

    Attributes:
        volumetric: the field of everything, and how both are rendered and trained.
        background: the field of the scene behind; of the same kind as the other.
        gap: between a ray's depths, see `depths`, from which on it sees a foreground.
        alone: share of the training in which only the field of everything and the detector are trained.
        background_weight: weight of the background's squared error.
        depth_weight: weight of the difference between the depths of both fields.
        early_correlation: weight of the detector's loss while they learn alone.
        late_correlation: weight of the detector's loss after that.
        detector_rate: learning rate of the detector.
    """

    volumetric: VolumetricConfig = field(default_factory=VolumetricConfig)
    background: HashFieldConfig | MlpFieldConfig = field(default_factory=HashFieldConfig)
    gap: float = 0.2
    alone: float = 0.3
    background_weight: float = 2.0
    depth_weight: float = 1.0
    early_correlation: float = 0.03
    late_correlation: float = 0.01
    detector_rate: float = 5e-3

    def __post_init__(self) -> None:
        alike = type(self.background) is type(self.volumetric.field)
        if not (0 < self.gap < 1 and 0 <= self.alone < 1 and alike):
            raise ValueError(f"{self}: expected gap in (0, 1), alone in [0, 1), two fields of one kind")
