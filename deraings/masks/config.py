"""How occlusion masks are learnt."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MaskConfig:
    """How masks are learnt."""

    start: float = 0.3  # share of the iterations after which the masks weigh the loss
    warm_up: float = 0.2  # the network learns for this share before
    every: int = 4  # iterations to a step of the network
    regularisation: float = 0.5  # lambda_reg in typical losses
    price: float = 1.0  # losses up to this many typical ones are not worth masking; 0 is the paper
    least_loss: float = 0.02  # the typical loss is taken to be at least this, so that well-fitted scenes stay unmasked
    least_evidence: float = 5.0  # for something on the lens, below which nothing is masked; 0 masks always
    rate: float = 5e-3  # of Adam; the paper's, for 70,000 iterations, is 1e-3
    shrink: int = 4  # the network works at this fraction of the picture's resolution
    fine: int = 2  # and gives this many mask pixels a side for each of its own
    width: int = 16  # channels of the encoder
    attention: bool = True  # whether channels are weighed by their high frequencies
    cutoff: float = 0.125  # of the high-pass filter, in cycles a pixel of the network's resolution
    lens_views: float = 8.0  # views before and after whose losses the network sees, as a standard deviation; or 0

    def __post_init__(self) -> None:
        if not (0 < self.start <= 1 and 0 <= self.warm_up <= self.start and self.every >= 1):
            raise ValueError(f"start {self.start}, warm_up {self.warm_up}, every {self.every}: no such schedule")
        if min(self.regularisation, self.least_loss, self.rate) <= 0 or min(self.price, self.lens_views) < 0:
            raise ValueError("regularisation, least_loss and rate must be positive, price and lens_views not negative")
        if self.shrink % self.fine:
            raise ValueError(f"fine {self.fine} must divide shrink {self.shrink}")
