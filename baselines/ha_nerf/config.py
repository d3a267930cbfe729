"""How Ha-NeRF's networks are built, priced and trained."""

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
class LookConfig(PhotographEncoderConfig):
    """The encoder of a photograph's look; `PAPER_LOOK` is the authors'. All convolutions but the first halve it."""

    size: int = 48  # length of an appearance code

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.size, *self.channels) < 1 or len(self.channels) < 2:
            raise ValueError(f"look {self}: expected sizes of 1 or more and two convolutions or more")
        smallest = max(4, 2 ** (len(self.channels) - 1))  # below it borders would be reflected onto themselves
        if self.side < smallest:
            raise ValueError(f"side {self.side}: expected at least {smallest}, which can be halved so often")


PAPER_LOOK = LookConfig(channels=(64, 128, 256, 256, 256))


@dataclass(frozen=True)
class VisibilityConfig(PriceConfig):
    """The network of the masks, and what masking costs; the defaults are the authors'."""

    code: int = 128  # length of a view's code
    octaves: int = 10  # octaves of the encoding of places
    width: int = 256  # units per layer
    layers: int = 4
    rate: float = 5e-4  # learning rate of Adam


@dataclass(frozen=True)
class HaNerfConfig(MaskedFieldConfig):
    """A field, its looks, its masks, and the grids of a step."""

    look: LookConfig = PAPER_LOOK
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)


# An encoder that sees sixteen photographs in some milliseconds.
SMALL_LOOK = LookConfig(channels=(8, 16, 32, 32), side=32, mean_share=0.5)
# Early errors are large everywhere, so a free mask hides detail that is not learned yet: what masking costs follows the
# typical error, from the first step on, and masks start next to nothing. Short trainings meet each pixel of a view but
# once or twice: of ten octaves the finest stay as ripples all over the mask.
SMALL_VISIBILITY = VisibilityConfig(octaves=7, width=128, rate=3e-3, at_first=0.05, price=3.5, relative=True)
# At a hash grid's rates a batch of one photograph pulls the field from view to view.
SMALL = HaNerfConfig(VolumetricConfig(field=SHORT_FIELD), SMALL_LOOK, SMALL_VISIBILITY, photographs=16)
PROFILES = {
    "demo": replace(SMALL, volumetric=replace(SMALL.volumetric, iterations=3500)),
    "standard": replace(SMALL, volumetric=replace(SMALL.volumetric, field=DETAILED_FIELD, iterations=13_000)),
    "paper": HaNerfConfig(
        replace(NERF, field=MlpFieldConfig(position_octaves=15), iterations=600_000, final_rate=0.01)
    ),
}
