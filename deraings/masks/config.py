"""Settings of occlusion masks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MaskConfig:
    """How masks are learned.

    Numbers without a source were chosen on courtyard in drops (raindrop-1 and raindrop-2), in the runs of
    docs/experiments/2026-11-occlusion-masks.md; "typical" is the running median loss of a pixel.

    Attributes:
        start: share of the iterations, (0, 1], after which the masks weigh the loss.
        every: iterations, at least 1, to a step of the network. With 12, an iteration is 2 ms longer on average at
            320x240 (one thread), with 4 more than 5 ms, and scenes are no better.
        regularisation: lambda_reg in typical losses, positive; the paper does not say.
        penalty: losses up to this many typical ones, from 0, are not worth masking; the paper has 0.
        min_evidence: for something on the lens (see `maps.evidence`), [0, 1], below which nothing is masked: dry
            scenes have 0 to 0.06, drops 0.2 and more. 0 masks always.
        rate: of Adam, positive; the paper has 1e-3, for 70,000 iterations.
        attention: whether channels are weighed by their high frequencies, as in the paper.
    """

    start: float = 0.3
    every: int = 12
    regularisation: float = 0.5
    penalty: float = 1.0
    min_evidence: float = 0.1
    rate: float = 5e-3
    attention: bool = True

    def __post_init__(self) -> None:
        if not (0 < self.start <= 1 and self.every >= 1):
            raise ValueError(f"start {self.start}, every {self.every}: no such schedule")
        if min(self.regularisation, self.rate) <= 0 or self.penalty < 0:
            raise ValueError("regularisation and rate must be positive, penalty not negative")
