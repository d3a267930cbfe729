"""How to render and train a radiance field."""

from dataclasses import dataclass, field, replace

from baselines.training.config import SessionConfig
from baselines.volumetric.fields.hash_grid import GridConfig


@dataclass(frozen=True)
class HashFieldConfig:
    """A hash grid under tiny networks (Mueller et al. 2022), with a density-only grid that proposes where to sample."""

    grid: GridConfig = field(default_factory=GridConfig)
    hidden: int = 64  # units per layer
    colour_layers: int = 2  # hidden layers of the colour network
    proposal_grid: GridConfig = field(default_factory=lambda: GridConfig(5, 14, 16, 256))
    rate: float = 1e-2  # learning rate of Adam


@dataclass(frozen=True)
class MlpFieldConfig:
    """The network of NeRF (Mildenhall et al. 2020), fine and coarse; the coarse one proposes where to sample."""

    width: int = 256
    depth: int = 8
    position_octaves: int = 10
    rate: float = 5e-4


@dataclass(frozen=True)
class PhotographEncoderConfig:
    """A network that looks at the whole of a photograph, in small (Ha-NeRF, CR-NeRF)."""

    channels: tuple[int, ...] = (64, 128, 128)  # of the convolutions, or of the stages that they are in
    side: int = 128  # side in pixels of the square that photographs are resized to
    rate: float = 5e-4  # learning rate of Adam
    mean_share: float = 0.0  # share of the rays of a step that use the mean of all photographs

    def __post_init__(self) -> None:
        if not 0 <= self.mean_share <= 1:
            raise ValueError(f"mean_share {self.mean_share}: expected a share")


@dataclass(frozen=True)
class VolumetricConfig(SessionConfig):
    """Rendering and training of one field."""

    iterations: int = 5000
    rays: int = 1024  # rays per step
    field: HashFieldConfig | MlpFieldConfig = field(default_factory=HashFieldConfig)
    proposal_samples: int = 48  # samples per ray of the proposal network
    samples: int = 24  # samples per ray of the field, drawn from the proposal's weights
    background: tuple[float, float, float] | None = None  # None: the last interval is infinite
    final_rate: float = 0.03  # factor of the learning rate at the end; exponential in between
    warm_up: int = 100  # iterations in which the learning rate rises
    anneal: int = 500  # iterations in which proposals sharpen (Mip-NeRF 360, equation 18) and learn in every step
    distortion: float = 0.0  # weight of the loss against scattered density


# Short trainings want large steps: on a made-up scene 250 iterations reach 18 dB at a rate of 0.01, 24 at 0.03.
SHORT_FIELD = HashFieldConfig(rate=2e-2)
# Longer ones have the time to fill more entries: on clean views of courtyard twice as many gain half a decibel.
DETAILED_FIELD = replace(SHORT_FIELD, grid=GridConfig(log2_entries=17))
# A coarse and a fine network as NeRF has them: the coarse one learns at every step, rates fall from the first one on.
NERF = VolumetricConfig(rays=1024, field=MlpFieldConfig(), proposal_samples=64, samples=64, warm_up=0, anneal=0)
