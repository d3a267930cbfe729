"""How CR-NeRF's networks are built, priced and trained."""

from dataclasses import dataclass, field, replace

from baselines.masking.rays import PriceConfig
from baselines.volumetric.config import DETAILED_FIELD, NERF, SHORT_FIELD, MlpFieldConfig, VolumetricConfig
from baselines.volumetric.rays.grids import side_of_grids


@dataclass(frozen=True)
class StyleConfig:
    """The encoder of a photograph's style; the defaults are the authors'."""

    channels: tuple[int, int, int] = (64, 128, 128)  # channels of the three stages; the picture is halved between them
    side: int = 128  # side in pixels of the square that photographs are resized to
    map_side: int = 32  # side of the style map in pixels
    rate: float = 5e-4  # learning rate of Adam
    penalty: float = 1e-5  # weight of the mean square of the map
    mean_share: float = 0.0  # share of the rays of a step that use the mean style

    def __post_init__(self) -> None:
        if not 0 <= self.mean_share <= 1:
            raise ValueError(f"mean_share {self.mean_share}: expected a share")
        if len(self.channels) != 3 or min(self.channels) < 1:
            raise ValueError(f"channels {self.channels}: expected three sizes of 1 or more")
        if self.map_side < 1 or self.side < 8:
            raise ValueError(f"side {self.side}, of the map {self.map_side}: expected at least 8, and at least 1")


@dataclass(frozen=True)
class TransformConfig:
    """The cross-ray transform; the defaults are the authors'."""

    size: int = 32  # side m of the matrices
    hidden: tuple[int, ...] = (128, 64)  # units of the networks whose covariances are used
    rate: float = 5e-4  # learning rate of Adam for the networks of both matrices


@dataclass(frozen=True)
class TransientConfig(PriceConfig):
    """The network of the masks, and what masking costs."""

    channels: int = 64
    dilations: tuple[int, ...] = (1, 2, 2, 4, 4)  # dilations of the convolutions after the first
    side: int = 256  # side in pixels of the square that photographs are resized to
    rate: float = 5e-4  # learning rate of Adam

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.channels < 1 or min((1, *self.dilations)) < 1:
            raise ValueError(f"transients {self}: expected sizes of 1 or more")
        if self.side < 2 * max((1, *self.dilations)) + 2:  # borders would be reflected onto themselves
            raise ValueError(f"side {self.side}: expected more than twice the largest dilation")


@dataclass(frozen=True)
class CrNerfConfig:
    """A field of features, the transform to colours, masks, and the grids of a step."""

    volumetric: VolumetricConfig = field(default_factory=VolumetricConfig)
    features: int = 64  # number of features per ray
    style: StyleConfig = field(default_factory=StyleConfig)
    transform: TransformConfig = field(default_factory=TransformConfig)
    transients: TransientConfig = field(default_factory=TransientConfig)
    photographs: int = 1  # photographs per step
    min_scale: float = 0.5  # smallest side of the grid of rays, as a share of the photograph's side

    def __post_init__(self) -> None:
        if not 1 <= self.transform.size <= self.features:
            raise ValueError(f"matrices of {self.transform.size}: expected 1 to {self.features}, the features")
        side_of_grids(self.volumetric.rays, self.photographs, self.min_scale)

    @property
    def side(self) -> int:
        """Rays on a side of a photograph's grid."""
        return side_of_grids(self.volumetric.rays, self.photographs, self.min_scale)


# Encoders that see sixteen photographs in some hundredths of a second.
SMALL_STYLE = StyleConfig(channels=(8, 16, 16), side=32, map_side=8, rate=1e-3, mean_share=0.5)
SMALL_TRANSFORM = TransformConfig(size=16, hidden=(32, 32), rate=1e-3)
# Early errors are large everywhere: what masking costs follows the mean error, and masks start next to nothing.
SMALL_TRANSIENTS = TransientConfig(
    channels=8,
    dilations=(1, 2, 4),
    side=96,
    rate=3e-3,
    at_first=0.05,
    price=1.0,
    price_at_first=1.0,
    price_fall=0.0,
    relative=True,
    typical="mean",
)
# At a hash grid's rates a batch of one photograph pulls the field from view to view.
SMALL = CrNerfConfig(
    VolumetricConfig(field=SHORT_FIELD),
    features=16,
    style=SMALL_STYLE,
    transform=SMALL_TRANSFORM,
    transients=SMALL_TRANSIENTS,
    photographs=16,
)
PROFILES = {
    "demo": replace(SMALL, volumetric=replace(SMALL.volumetric, iterations=3000)),
    "quick": replace(SMALL, volumetric=replace(SMALL.volumetric, field=DETAILED_FIELD, iterations=10_000)),
    "paper": CrNerfConfig(
        replace(NERF, field=MlpFieldConfig(position_octaves=15), iterations=600_000, final_rate=0.01)
    ),
}
