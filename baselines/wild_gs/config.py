"""How Wild-GS' networks are built and trained."""

from dataclasses import dataclass, replace

from baselines.encoders.config import EncoderConfig


@dataclass(frozen=True)
class LookConfig(EncoderConfig):
    """Settings beside those of the Gaussians; the defaults and `PAPER` are those of the profile `paper`.

    Of Xu et al. 2024: 16, 32, the prices 0.4 and 0.1. The others are ours: the paper does not give them, but for the
    box, which it cuts to 0.5 of the extent of all. That would leave nine tenths of courtyard's points outside.
    """

    code: int = 16  # length of the global code and of the local code
    intrinsic: int = 32  # length of a Gaussian's intrinsic code
    side: int = 128  # side in pixels of the six pictures and of the triplane
    box: float = 1.0  # share of the extent of nearly all Gaussians that the triplane covers, per axis
    lifted: int = 256  # longer side in pixels of the lifted picture
    renewed: int = 500  # steps of a view between two renders of its depth
    local_from: float = 1 / 15  # share of the iterations after which local codes are used
    price_first: float = 0.4  # weight of mean((1 - m)^2) in the loss in the first step
    price_last: float = 0.1  # weight of mean((1 - m)^2) in the last step; linear in between
    rate_encoder: float = 5e-4  # learning rate of the encoder
    rate_networks: float = 5e-4  # learning rate of the triplane's U-Net and of the networks of codes and colours
    rate_intrinsic: float = 2.5e-3  # learning rate of the intrinsic codes

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.code, self.intrinsic, self.lifted, self.renewed) < 1:
            raise ValueError("lengths, lifted and renewed: expected 1 or more")
        if self.side < 4 or self.side % 4:
            raise ValueError(f"side {self.side}: expected a multiple of 4")
        rates = (self.rate_encoder, self.rate_networks, self.rate_intrinsic)
        if min(self.box, self.price_first, self.price_last, *rates) <= 0:
            raise ValueError("box, rates and prices must be positive")


PAPER = LookConfig(visible_from=0.05, lpips=0.0)
# Two cores: a reference of half the size, a U-Net of 0.2 million weights, a coarser triplane. In every second step the
# Gaussians know nothing of the reference, so that what can be said without one is learned without one.
SHORT = replace(
    PAPER, backbone="small", shrink=2, absent=0.5, visible_from=0.1, side=64, lifted=160, renewed=300, local_from=0.2
)
