"""NeRF in the Wild (Martin-Brualla et al. 2021): an appearance for every photograph, and matter that only it has seen.

Section 4.1, latent appearance: every training view i has an embedding l_i^(a), given to the colour head. Section
4.2, transient objects: a second head turns the trunk's features and an embedding l_i^(tau) into density, colour and
uncertainty of what is in view i alone. Rendered without that head and with the mean embedding, the scene is as it is
without the rain.

Where this deviates, beside what all radiance fields here share (docs/methods/radiance-fields.md), and why:

* Static and transient share what an interval emits in proportion to their densities, the exact integral over matter
  that is mixed evenly; the paper's alphas of both (its equation 8) add up to more than one where both are opaque, as in
  the last interval they always would be.
* beta_min is added after compositing, as in the public implementation. In the paper it is part of every sample's
  beta, which leaves rays without transient matter with no uncertainty at all, and its logarithm without a bound.
* Embeddings start near zero instead of at unit variance: where photographs look alike the mean embedding is then one
  that was trained, not a point between far-apart ones.
* Small profiles have a hash grid for the networks' eight layers, and proposals for the coarse network (which then has
  no colours: its loss is Mip-NeRF 360's). The paper profile has the networks; its units are the public
  implementation's (256, not 512).
* The coarse network has no embeddings, as in the public implementation; in the paper it is given the appearance.
* Test views are rendered with the mean embedding; the paper fits one to one half of each test view.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from baselines.method import Citation
from baselines.volumetric.compositing import along_ray, compositing_weights
from baselines.volumetric.config import DETAILED_FIELD, NERF, SHORT_FIELD, VolumetricConfig
from baselines.volumetric.fields.encodings import linear
from baselines.volumetric.losses import Loss, Losses, proposal_losses
from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.model import RadianceModel, Rendering, Samples, TrainingContext
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.spaces import Rays, Space

APPEARANCE, TRANSIENT = 48, 16  # lengths of embeddings in the paper
BETA_MIN = 0.03  # of the paper
START = 0.01  # standard deviation of embeddings before training


@dataclass(frozen=True)
class NerfWConfig:
    """A field, the embeddings of the views, and the four-term loss."""

    volumetric: VolumetricConfig = field(default_factory=VolumetricConfig)
    transient_width: int = 32  # units of the transient head's layers
    transient_layers: int = 2
    density_weight: float = 0.01  # lambda_u: weight of the mean transient density
    embedding_rate: float = 5e-3  # learning rate of the embeddings
    mean_appearance_share: float = 0.0  # share of the rays of a step that use the mean appearance


class TransientHead(nn.Module):
    """Density, colour and uncertainty of what only one view has seen, from features and that view's embedding."""

    def __init__(self, features: int, config: NerfWConfig, generator: torch.Generator):
        super().__init__()
        width = config.transient_width
        self.entry = linear(features, width, generator)
        self.embedding_entry = linear(TRANSIENT, width, generator, bias=False)
        self.middle = nn.ModuleList(linear(width, width, generator) for _ in range(config.transient_layers - 1))
        self.exit = linear(width, 5, generator)

    def forward(self, features: Tensor, embeddings: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Densities [R, S], colours [R, S, 3] and uncertainties [R, S] for features [R, S, F], embeddings [R, E]."""
        hidden = (self.entry(features) + self.embedding_entry(embeddings)[:, None]).relu_()
        for layer in self.middle:
            hidden = layer(hidden).relu_()
        outputs = self.exit(hidden)
        softplus = nn.functional.softplus
        return softplus(outputs[..., 0]), torch.sigmoid(outputs[..., 1:4]), softplus(outputs[..., 4])


class NerfWModel(RadianceModel):
    """The field with embeddings and a transient head."""

    def __init__(self, config: NerfWConfig, space: Space, generator: torch.Generator, views: int):
        super().__init__(config.volumetric, space, generator, APPEARANCE)
        self.embedding_rate = config.embedding_rate
        self.mean_appearance_share = config.mean_appearance_share
        self.appearance = nn.Parameter(START * torch.randn(views, APPEARANCE, generator=generator))
        self.transient = nn.Parameter(START * torch.randn(views, TRANSIENT, generator=generator))
        self.head = TransientHead(self.field.features, config, generator)

    def groups(self) -> list[dict[str, Any]]:
        """See RadianceModel; embeddings have their own rate."""
        embeddings = [self.appearance, self.transient]
        others = [p for p in self.parameters() if all(p is not embedding for embedding in embeddings)]
        return [{"params": others, "lr": self.config.field.rate}, {"params": embeddings, "lr": self.embedding_rate}]

    def shade(self, rays: Rays, samples: Samples, context: TrainingContext | None) -> Rendering:
        """See RadianceModel; without `context` the static scene in its mean appearance."""
        mean = self.appearance.mean(0).expand(len(rays.origins), -1)
        if context is None:
            return self.composited(self.field, rays, samples, mean)[0]
        density, features = self.field.geometry(samples.points)
        embeddings = nn.functional.embedding(context.views, self.appearance)
        as_mean = round(self.mean_appearance_share * len(mean))
        colours = self.field.colour(features, rays.viewing, torch.cat([mean[:as_mean], embeddings[as_mean:]]))
        passing, passing_colours, uncertainty = self.head(
            features, nn.functional.embedding(context.views, self.transient)
        )
        weights, left = compositing_weights(density + passing, samples.lengths)
        share = passing / (density + passing).clamp_min(1e-12)
        static, transient = weights * (1 - share), weights * share
        seen = along_ray(static, colours) + along_ray(transient, passing_colours)
        extras = {"beta": BETA_MIN + (transient * uncertainty).sum(1), "density": passing}
        return Rendering(self.over_background(seen, left), weights, samples, samples.edges, weights, extras=extras)


def nerf_w_losses(config: NerfWConfig) -> Loss:
    """The loss (equation 13): error over uncertainty, the uncertainty's logarithm, transient density, proposals."""

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        beta = rendering.extras["beta"]
        error = (rendering.colour - batch.colours).square().mean(1)
        losses = {
            "colour": (batch.weights * error / (2 * beta**2)).mean(),
            "uncertainty": (batch.weights * beta.log()).mean(),
            "density": config.density_weight * (batch.weights[:, None] * rendering.extras["density"]).mean(),
        }
        return losses | proposal_losses(rendering, batch, config.volumetric, coarse=0.5)

    return loss


SMALL = VolumetricConfig(field=SHORT_FIELD)
# What a stretch of views has in common goes into their embeddings, and is missing in the mean appearance, which is
# scored: so embeddings learn more slowly, and half of the rays see none. docs/methods/radiance-fields.md has figures.
SHORT = NerfWConfig(SMALL, embedding_rate=1e-3, mean_appearance_share=0.5)
PAPER = replace(NERF, iterations=300_000, final_rate=0.01)
PROFILES = {
    "demo": replace(SHORT, volumetric=replace(SMALL, iterations=3500)),
    "standard": replace(SHORT, volumetric=replace(SMALL, field=DETAILED_FIELD, iterations=13_000)),
    "paper": NerfWConfig(PAPER, transient_width=128, transient_layers=4, embedding_rate=5e-4),
}


class NerfW(RadianceMethod):
    """NeRF-W (Martin-Brualla et al. 2021): a radiance field with appearance and transient embeddings per view."""

    citation = Citation(
        title="NeRF in the Wild",
        paper="NeRF in the Wild: Neural Radiance Fields for Unconstrained Photo Collections",
        authors="R. Martin-Brualla, N. Radwan, M. S. M. Sajjadi, J. T. Barron, A. Dosovitskiy, D. Duckworth",
        year=2021,
        link="https://arxiv.org/abs/2008.02268",
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def make(self, space: Space, generator: torch.Generator, views: int) -> NerfWModel:
        """See RadianceMethod."""
        return NerfWModel(self.config, space, generator, views)

    def loss(self) -> Loss:
        """See RadianceMethod."""
        return nerf_w_losses(self.config)
