"""The field of Ha-NeRF, with the looks and masks of its training views."""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from baselines.ha_nerf.config import HaNerfConfig
from baselines.ha_nerf.look import LookEncoder
from baselines.ha_nerf.visibility import Visibility
from baselines.masking.rays import MaskedField, Running, price_of_masking
from baselines.splatting.kernels.photometric import Plane
from baselines.training.images import Size, TrainingImages
from baselines.volumetric.model import Rendering, Samples, TrainingContext
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.photographs import AT_ONCE, as_seen, rays_of_the_mean, small_pictures
from baselines.volumetric.rays.spaces import Rays, Space


class HaNerfModel(MaskedField):
    """A field whose colours depend on the photograph's look, and masks for what only one photograph shows."""

    def __init__(self, config: HaNerfConfig, space: Space, generator: torch.Generator, views: int):
        super().__init__(config.volumetric, space, generator, config.look.size)
        self.settings = config
        self.encoder = LookEncoder(config.look, generator)
        self.visibility = Visibility(config.visibility, views, generator)
        self.running = Running(views, config.photographs, config.visibility.at_first, config.visibility.typical)
        self.looks: Tensor  # of the views, when last visited [V, E]
        self.register_buffer("looks", torch.zeros(views, config.look.size))
        self._pictures = torch.zeros(0, 3, 1, 1, dtype=torch.uint8)  # of the views, small; in training alone

    def groups(self) -> list[dict[str, Any]]:
        """See RadianceModel; encoder and masks have rates of their own."""
        encoder, visibility = list(self.encoder.parameters()), list(self.visibility.parameters())
        apart = {id(parameter) for parameter in (*encoder, *visibility)}
        return [
            {"params": [p for p in self.parameters() if id(p) not in apart], "lr": self.config.field.rate},
            {"params": encoder, "lr": self.settings.look.rate},
            {"params": visibility, "lr": self.settings.visibility.rate},
        ]

    def prepare(self, images: TrainingImages) -> None:
        """See RadianceModel; keeps small pictures and their looks."""
        self._pictures = small_pictures(images, self.settings.look.side)
        self.finish()

    @torch.no_grad()
    def finish(self) -> None:
        """See RadianceModel; the looks of all views, whose mean is rendered, as the encoder now has them."""
        self.looks.copy_(torch.cat([self._looks(part) for part in self._pictures.split(AT_ONCE)]))

    def _looks(self, pictures: Tensor) -> Tensor:
        looks: Tensor = self.encoder(as_seen(pictures.to(self.looks.device)))
        return looks

    def shade(self, rays: Rays, samples: Samples, context: TrainingContext | None) -> Rendering:
        """See RadianceModel; without `context` the scene in its mean look."""
        mean = self.looks.mean(0).expand(len(rays.origins), -1)
        extras, looks = {}, mean
        if context is not None:
            assert context.places is not None, "batches of `grids` have places"
            visited, which = torch.unique_consecutive(context.views, return_inverse=True)
            visited_looks = self._looks(self._pictures[visited.cpu()])
            as_mean = rays_of_the_mean(len(mean), self.settings.look.mean_share, mean.device)
            looks = torch.where(as_mean[:, None], mean, visited_looks[which])
            extras = {
                "m": self.visibility(context.views, context.places),
                "price": price_of_masking(self.settings.visibility, self.running),
                "visited": visited,
                "looks": visited_looks,
            }
        return replace(self.composited(self.field, rays, samples, looks)[0], extras=extras)

    @torch.no_grad()
    def mask(self, view: int, size: Size) -> Plane:
        """See MaskedField."""
        return self.visibility.plane(view, size)

    @torch.no_grad()
    def after_step(self, rendering: Rendering, batch: Batch) -> None:
        """See RadianceModel; keeps the looks and the typical error."""
        extras = rendering.extras
        self.looks[extras["visited"]] = extras["looks"]
        errors = (rendering.colour - batch.colours).square().mean(1)
        self.running.observe(errors, extras["m"], batch.weights > 0)
