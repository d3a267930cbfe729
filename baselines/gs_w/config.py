"""How GS-W's networks are built and trained."""

from dataclasses import dataclass

from baselines.encoders.config import EncoderConfig

CHANNELS = 16  # of a feature map (the authors)


@dataclass(frozen=True)
class ReferenceConfig(EncoderConfig):
    """Settings beside those of the Gaussians; the defaults are those of Zhang et al. 2024 and of their public code.

    But for `rate_coordinates`: theirs move at 1 in a box that is scaled, ours in one from -1 to 1 from the start.
    """

    maps: int = 2  # number K of adaptive feature maps, beside one projection map
    frequencies: int = 10  # number of frequencies of the positions' Fourier features
    encoder: tuple[int, ...] = (128, 96, 64)  # hidden layers in the first half of the fusion network
    decoder: tuple[int, ...] = (48,)  # hidden layers in the second half of the fusion network
    colour: tuple[int, ...] = (48,)  # hidden layers of the colour network
    fused: int = 48  # length of the feature between both networks
    dropout: float = 0.1  # share of the Gaussians' features per map that a step drops
    rate_maps: float = 2e-3  # learning rate of the U-Net
    rate_colour: float = 5e-4  # learning rate of the fusion and colour networks
    rate_coordinates: float = 4e-3  # learning rate of the coordinates in the maps, in [-1, 1]
    visible_price: float = 0.15  # weight of mean((1 - m)^2) in the loss

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.dropout < 1:
            raise ValueError(f"dropout {self.dropout}: expected a share below 1")
        if self.maps < 1:
            raise ValueError(f"maps {self.maps}: expected 1 or more")
        if min(self.rate_maps, self.rate_colour, self.rate_coordinates, self.visible_price) <= 0:
            raise ValueError("rates and visible_price must be positive")

    @property
    def dynamic(self) -> int:
        """Length of the dynamic feature: all maps' channels, the projection map's first."""
        return (1 + self.maps) * CHANNELS


# Two cores: a reference of half the size, a U-Net of 0.2 million weights, fewer and narrower layers, no LPIPS.
# Rates are not raised for short runs: at 2e-3 the networks separate views that do not differ, and clean views of
# Mip-NeRF 360 bonsai (160 pixels, 2,000 iterations) come out at 24.40 dB, so at 24.87; plain splatting has 25.06.
SHORT = ReferenceConfig(
    backbone="small",
    shrink=2,
    frequencies=2,
    encoder=(48,),
    decoder=(),
    colour=(32,),
    fused=32,
    absent=0.5,
    rate_maps=5e-4,
    rate_coordinates=1e-2,
    visible_from=0.1,
    lpips=0.0,
)
