"""Two fields along the same rays: one of everything that the photographs show, one of the scene behind occluders."""

from typing import Any

import torch
from torch import Tensor

from baselines.occ_nerf.config import OccNerfConfig
from baselines.occ_nerf.depths import depth, depth_from_behind, middles
from baselines.occ_nerf.detector import Detector
from baselines.volumetric.config import HashFieldConfig, MlpFieldConfig
from baselines.volumetric.fields.fields import HashField, MlpField
from baselines.volumetric.model import RadianceModel, Rendering, Samples, TrainingContext
from baselines.volumetric.rays.spaces import Rays, Space


class OccNerfModel(RadianceModel):
    """`field` is of everything, `background` of the scene behind, which is what is shown.

    Both are rendered at the same samples: the proposals bound what either sees, so that there are samples at an
    occluder and at what it hides.
    """

    def __init__(self, config: OccNerfConfig, space: Space, generator: torch.Generator):
        """Random start; see RadianceModel."""
        super().__init__(config.volumetric, space, generator)
        self.occlusion = config
        self.background: HashField | MlpField
        if isinstance(config.background, HashFieldConfig):
            self.background = HashField(config.background, 0, generator)
        else:
            self.background = MlpField(config.background, 0, generator)
        coarse = isinstance(config.volumetric.field, MlpFieldConfig)  # whose samples are rendered as well
        samples = config.volumetric.samples + (config.volumetric.proposal_samples - 1 if coarse else 0)
        self.detector = Detector(samples, generator)

    def groups(self) -> list[dict[str, Any]]:
        """See RadianceModel; the detector has a rate of its own, and the background begins with the whole rate."""
        rate, fallen = self.config.field.rate, self.config.final_rate**self.occlusion.alone
        return [
            {"params": [*self.field.parameters(), *self.proposal.parameters()], "lr": rate},
            {"params": list(self.background.parameters()), "lr": rate / fallen},
            {"params": list(self.detector.parameters()), "lr": self.occlusion.detector_rate},
        ]

    @property
    def open_end(self) -> bool:
        """Whether the last interval of a ray reaches to infinity."""
        return self.config.background is None

    def shade(self, rays: Rays, samples: Samples, context: TrainingContext | None) -> Rendering:
        """See RadianceModel; without `context` the background alone."""
        if context is None:
            return self.composited(self.background, rays, samples)[0]
        rendering, density = self.composited(self.field, rays, samples)
        positions = middles(samples.edges, self.space, self.open_end)
        near = depth(rendering.weights, positions)
        behind = depth_from_behind(density.detach(), samples.lengths, positions, self.open_end)
        m = self.detector(rendering.weights, near, behind)
        rendering.extras.update(foreground=m, gap=behind - near.detach(), depth=near)
        if context.progress >= self.occlusion.alone:
            back, _ = self.composited(self.background, rays, samples)
            shown = {"colour": back.colour, "weights": back.weights, "depth": depth(back.weights, positions)}
            rendering.extras.update({f"background_{name}": value for name, value in shown.items()})
        return rendering

    @torch.no_grad()
    def foreground(self, rays: Rays) -> Tensor:
        """m [R] of rays: foreground from 0.5 on."""
        count = len(rays.origins)
        device = rays.origins.device
        jitter = torch.full((2, count), 0.5, device=device)
        context = TrainingContext(torch.zeros(count, dtype=torch.long, device=device), jitter)
        return self(rays, context).extras["foreground"]
