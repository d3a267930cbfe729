"""How CR-NeRF's networks are built, priced and trained."""

from dataclasses import dataclass, field, replace

from baselines.masking.rays import MaskedFieldConfig, PriceConfig
from baselines.volumetric.config import (
    DETAILED_FIELD,
    NERF,
    SHORT_FIELD,
    MlpFieldConfig,
    PhotographEncoderConfig,
    VolumetricConfig,
)


@dataclass(frozen=True)
class StyleConfig(PhotographEncoderConfig):
    """The encoder of a photograph's style, whose rate the networks of both matrices have too; the authors' defaults."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.channels) != 3 or min(self.channels) < 1:
            raise ValueError(f"channels {self.channels}: expected three sizes of 1 or more")
        if self.side < 8:
            raise ValueError(f"side {self.side}: expected at least 8")


@dataclass(frozen=True)
class TransformConfig:
    """The cross-ray transform; the defaults are the authors'."""

    size: int = 32  # side m of the matrices
    hidden: tuple[int, ...] = (128, 64)  # units of the networks whose covariances are used


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
class CrNerfConfig(MaskedFieldConfig):
    """A field of features, the transform to colours, masks, and the grids of a step."""

    features: int = 64  # number of features per ray
    style: StyleConfig = field(default_factory=StyleConfig)
    transform: TransformConfig = field(default_factory=TransformConfig)
    transients: TransientConfig = field(default_factory=TransientConfig)

    def __post_init__(self) -> None:
        if not 1 <= self.transform.size <= self.features:
            raise ValueError(f"matrices of {self.transform.size}: expected 1 to {self.features}, the features")
        super().__post_init__()


# Encoders that see sixteen photographs in some hundredths of a second.
SMALL_STYLE = StyleConfig(channels=(8, 16, 16), side=32, rate=1e-3, mean_share=0.5)
SMALL_TRANSFORM = TransformConfig(size=16, hidden=(32, 32))
# Early errors are large everywhere: what masking costs follows the mean error, and masks start next to nothing.
SMALL_TRANSIENTS = TransientConfig(
    channels=8,
    dilations=(1, 2, 4),
    side=96,
    rate=3e-3,
    at_first=0.05,
    price=1.0,
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
    "standard": replace(SMALL, volumetric=replace(SMALL.volumetric, field=DETAILED_FIELD, iterations=10_000)),
    "paper": CrNerfConfig(
        replace(NERF, field=MlpFieldConfig(position_octaves=15), iterations=600_000, final_rate=0.01)
    ),
}
