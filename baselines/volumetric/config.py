"""How to render and train a radiance field."""

from dataclasses import dataclass, field

from baselines.volumetric.hash_grid import GridConfig


@dataclass(frozen=True)
class HashFieldConfig:
    """A hash grid under tiny networks (Mueller et al. 2022), with a density-only grid that proposes where to sample."""

    grid: GridConfig = field(default_factory=GridConfig)
    hidden: int = 64  # units of a layer
    features: int = 15  # handed from density to colour
    colour_layers: int = 2  # hidden layers of the colour network
    guide_grid: GridConfig = field(default_factory=lambda: GridConfig(5, 14, 16, 256))
    guide_hidden: int = 16
    rate: float = 1e-2  # of Adam


@dataclass(frozen=True)
class MlpFieldConfig:
    """The network of NeRF (Mildenhall et al. 2020), fine and coarse; the coarse one guides the samples."""

    width: int = 256
    depth: int = 8
    skip: int = 4  # after this many layers the encoded position comes in again
    position_octaves: int = 10
    direction_octaves: int = 4
    rate: float = 5e-4


@dataclass(frozen=True)
class VolumetricConfig:
    """Rendering and training of one field."""

    iterations: int = 5000
    rays: int = 1024  # a step
    field: HashFieldConfig | MlpFieldConfig = field(default_factory=HashFieldConfig)
    space: str = "auto"  # contracted, ndc, or auto: ndc where all cameras look the same way
    guide_samples: int = 48  # a ray, to find out where samples are needed
    samples: int = 24  # a ray, drawn there
    background: tuple[float, float, float] | None = None  # None: the last interval reaches to infinity
    final_rate: float = 0.03  # of the learning rate, reached exponentially
    rising: int = 100  # iterations over which the rate rises
    anneal: int = 500  # iterations over which proposals sharpen (Mip-NeRF 360, equation 18)
    teach_always: int = 500  # iterations in which the guide learns at every step
    teach_every: int = 4  # and after which it learns at every so many steps
    interlevel: float = 1.0  # weight of the loss that teaches the guide
    distortion: float = 0.0  # weight of the loss against scattered density
    device: str = "auto"  # auto, cpu or cuda; $HYDROVIEWS_DEVICE comes first
    checkpoint_seconds: float = 30.0  # of training between two checkpoints


# A coarse and a fine network as NeRF has them: the coarse one learns at every step, rates fall from the first one on.
NERF = VolumetricConfig(
    rays=1024, field=MlpFieldConfig(), guide_samples=64, samples=64, rising=0, anneal=0, teach_every=1
)
