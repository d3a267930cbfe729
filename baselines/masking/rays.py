"""Weights of the rays of radiance fields: masks m, 1 where the scene need not explain a pixel (Ha-NeRF, CR-NeRF).

How m comes about is each method's own. What masking costs, the loss, and what a method says of its masks are here.
Rays are few, drawn from several views, and have gradients: so the loss takes m itself, and not weights of whole views.
"""

import logging
import math
from abc import abstractmethod
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from baselines.method import TrainingSummary
from baselines.splatting.kernels.photometric import Plane
from baselines.training.images import Size
from baselines.volumetric.config import VolumetricConfig
from baselines.volumetric.losses import Losses, proposal_losses, squared_error
from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.model import RadianceModel, Rendering
from baselines.volumetric.rays.batches import Batch, Draw
from baselines.volumetric.rays.grids import grids, side_of_grids

logger = logging.getLogger(__name__)

GREY = 1 / 12  # squared error of grey for values that are spread evenly: the typical one before the first step
LEAST = 1e-6  # typical errors are taken to be at least this, so that masking always costs something
KEPT = 0.5  # of a running value after every view was visited once more
# An absolute price begins at the first number and falls at the second, an exponential rate a visit (Ha-NeRF's authors).
PRICE_AT_FIRST, PRICE_FALL = 5e-2, 0.75
MOST, AFTER = 0.6, 2  # share of the pixels masked, and visits of each view, from which on masks hide the scene itself


@dataclass(frozen=True)
class PriceConfig:
    """Where masks start, and what masking costs; the defaults are those of Ha-NeRF's authors."""

    at_first: float = 0.5  # value of m before the first step
    price: float = 6e-3  # lambda_s: weight of the mean of m^2 in the loss
    relative: bool = False  # whether the price is a multiple of the recent typical squared error, or falls to `price`
    typical: str = "median"  # typical error of a step: median or mean

    def __post_init__(self) -> None:
        if not 0 < self.at_first < 1:
            raise ValueError(f"at_first {self.at_first}: expected a number between 0 and 1")
        if self.price <= 0:
            raise ValueError(f"price {self.price}: expected a positive price")
        if self.typical not in ("median", "mean"):
            raise ValueError(f"typical {self.typical}: expected median or mean")


@dataclass(frozen=True)
class MaskedFieldConfig:
    """A field that learns from grids of rays in a few photographs."""

    volumetric: VolumetricConfig = field(default_factory=VolumetricConfig)
    photographs: int = field(default=1, kw_only=True)  # photographs per step

    def __post_init__(self) -> None:
        side_of_grids(self.volumetric.rays, self.photographs)

    @property
    def side(self) -> int:
        """Rays on a side of a photograph's grid."""
        return side_of_grids(self.volumetric.rays, self.photographs)


class Running(nn.Module):
    """What training has seen of late: a typical error, and how much is masked."""

    def __init__(self, views: int, photographs: int, at_first: float, typical: str = "median"):
        super().__init__()
        self.average = torch.mean if typical == "mean" else torch.median
        self.kept = KEPT ** (photographs / views)  # a step
        self.visits_a_step = photographs / views
        self.typical: Tensor  # median or mean of the squared errors
        self.masked: Tensor  # mean of m
        self.steps: Tensor
        self.register_buffer("typical", torch.tensor(GREY))
        self.register_buffer("masked", torch.tensor(at_first))
        self.register_buffer("steps", torch.tensor(0))
        self.warned: Tensor  # kept like the others: a training that is resumed says nothing twice
        self.register_buffer("warned", torch.tensor(False))

    @torch.no_grad()
    def observe(self, errors: Tensor, m: Tensor, counts: Tensor) -> None:
        """Take in a step's squared errors [R] and masks [R], of those that count (bool [R]).

        Says so, once, if masks hide most of the photographs.
        """
        self.steps += 1
        if counts.any():
            self.typical.lerp_(self.average(errors[counts]), 1 - self.kept)
            self.masked.lerp_(m[counts].mean(), 1 - self.kept)
        if not self.warned and self.visits > AFTER and self.masked > MOST:
            logger.warning(
                "masks hide %.0f %% of the photographs after %.1f visits of each: the scene is learned from the rest",
                100 * float(self.masked),
                self.visits,
            )
            self.warned.fill_(True)

    @property
    def visits(self) -> float:
        """How often each view was visited so far, on average."""
        return float(self.steps) * self.visits_a_step


def price_of_masking(config: PriceConfig, running: Running) -> Tensor:
    """lambda_s, the weight of mean(m^2): falls with the visits of each view, or follows the typical error.

    Where 0.5 (1 - m) e + lambda_s m^2 is smallest, m = e / (4 lambda_s), or 1 if that is more. A relative price of p
    so masks what has a squared error of 4 p times the typical one, and 1 / (4 p) of what has that error itself. With
    the mean for the typical error, pixels that cannot be explained are masked where they are fewer than 1 / (4 p) of
    all: a share s of them, with an error E, makes the mean s E.
    """
    if config.relative:
        return config.price * running.typical.clamp_min(LEAST)
    price = max(config.price, PRICE_AT_FIRST * math.exp(-PRICE_FALL * running.visits))
    return price * torch.ones_like(running.typical)


def pixel_places(size: tuple[int, int], device: torch.device) -> Tensor:
    """The places [H, W, 2] of all pixels of a view at (height, width), as a batch has them."""
    rows, columns = ((torch.arange(count, device=device) + 0.5) / count for count in size)
    return torch.stack(torch.meshgrid(rows, columns, indexing="ij"), 2)


class MaskedField(RadianceModel):
    """A radiance field with masks of its training views."""

    running: Running

    @abstractmethod
    def mask(self, view: int, size: Size) -> Plane | None:
        """m [H, W] of a training view at (height, width); None where its photograph is not at hand."""


class MaskedFieldMethod(RadianceMethod):
    """A method whose steps see grids of rays in a few photographs, masked by a MaskedField."""

    def draw(self) -> Draw:
        """See RadianceMethod."""
        return grids(self.config.photographs, self.config.side)

    @torch.no_grad()
    def hidden(self, view: int, size: Size) -> Plane | None:
        """See Method: m."""
        return self._field.mask(view, size)

    def summary(self) -> TrainingSummary:
        """See Method; also how much of the photographs was masked at the end."""
        return replace(super().summary(), used=f"{float(self._field.running.masked):.1%} of the pixels masked")

    @property
    def _field(self) -> MaskedField:
        model = self._require().trained.model
        assert isinstance(model, MaskedField)
        return model


def masked_losses(rendering: Rendering, batch: Batch, config: VolumetricConfig, own: Losses) -> Losses:
    """The losses of a step whose rendering has masks `m` and a `price` in its extras.

    colour  0.5 mean((1 - m) |C - C*|^2), and so for a coarse field, whose error teaches m nothing
    size    lambda_s mean(m^2), without which everything would be masked

    a method's own, and that of the proposal network. Pixels of weight 0 count in none of them.
    """
    m, counts = rendering.extras["m"], batch.weights
    visible = replace(batch, weights=counts * (1 - m.detach()))
    return {
        "colour": ((1 - m) * squared_error(rendering.colour, batch)).mean() / 2,
        "size": rendering.extras["price"] * (counts * m.square()).mean(),
        **own,
        **proposal_losses(rendering, visible, config, coarse=0.5),
    }
