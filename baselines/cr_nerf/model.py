"""The field of CR-NeRF: features along rays, the transform that makes colours of them, styles and masks."""

from typing import Any

import torch
from torch import Tensor, nn

from baselines.cr_nerf.config import CrNerfConfig
from baselines.cr_nerf.style import StyleEncoder
from baselines.cr_nerf.transform import CrossRayTransform, Mixing
from baselines.cr_nerf.transients import TransientNetwork, read
from baselines.masking.rays import MaskedField, Running, pixel_places, price_of_masking
from baselines.splatting.kernels.photometric import Plane
from baselines.training.images import Size, TrainingImages
from baselines.volumetric.compositing import along_ray, compositing_weights
from baselines.volumetric.model import Rendering, Samples, TrainingContext
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.photographs import AT_ONCE, as_seen, rays_of_the_mean, small_pictures
from baselines.volumetric.rays.spaces import Rays, Space

KEPT = 0.99  # of the statistics of the rays, a step


class CrNerfModel(MaskedField):
    """A field of features whose colours depend on all rays of a step and on the photograph, and masks.

    Of the rays it keeps running averages, `content_mean` and `content_matrix`, with which it renders: so what a ray
    shows depends on no other ray. Of the views it keeps what their styles contribute, whose means are rendered.
    """

    def __init__(self, config: CrNerfConfig, space: Space, generator: torch.Generator, views: int):
        """Random start; see RadianceModel."""
        super().__init__(config.volumetric, space, generator, channels=config.features)
        self.settings, features, size = config, config.features, config.transform.size
        self.transform = CrossRayTransform(config.transform, features, generator)
        self.content = Mixing(config.transform, features, generator)
        self.style = Mixing(config.transform, features, generator)
        self.encoder = StyleEncoder(config.style, features, generator)
        self.transients = TransientNetwork(config.transients, generator)
        self.running = Running(views, config.photographs, config.transients.at_first, config.transients.typical)
        self.content_mean: Tensor
        self.content_matrix: Tensor
        self.style_means: Tensor  # of the views, when last visited
        self.style_matrices: Tensor
        self.register_buffer("content_mean", torch.zeros(features))
        self.register_buffer("content_matrix", torch.eye(size))
        self.register_buffer("style_means", torch.zeros(views, features))
        self.register_buffer("style_matrices", torch.eye(size).repeat(views, 1, 1))
        # Of the views, small, for both networks; in training alone.
        self._pictures = torch.zeros(0, 3, 1, 1, dtype=torch.uint8)
        self._larger = torch.zeros(0, 3, 1, 1, dtype=torch.uint8)

    def groups(self) -> list[dict[str, Any]]:
        """See RadianceModel; what comes after compositing learns as the field, the other networks at their rates."""
        config = self.settings

        def of(*modules: nn.Module) -> list[nn.Parameter]:
            return [parameter for module in modules for parameter in module.parameters()]

        return [
            {"params": of(self.field, self.proposal, self.transform), "lr": self.config.field.rate},
            {"params": of(self.content, self.style), "lr": config.style.rate},
            {"params": of(self.encoder), "lr": config.style.rate},
            {"params": of(self.transients), "lr": config.transients.rate},
        ]

    def prepare(self, images: TrainingImages) -> None:
        """See RadianceModel; keeps small pictures, and their styles."""
        self._pictures = small_pictures(images, self.settings.style.side)
        self._larger = small_pictures(images, self.settings.transients.side)
        self.finish()

    @torch.no_grad()
    def finish(self) -> None:
        """See RadianceModel; the styles of all views, whose mean is rendered, as the networks now have them."""
        for views in torch.arange(len(self._pictures)).split(AT_ONCE):
            _, self.style_means[views], self.style_matrices[views] = self._styles(views)

    def _styles(self, views: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Of views [N] the style maps [N, h w, C], and what they contribute: mean S [N, C] and A_s(S0) [N, m, m]."""
        maps = self.encoder(as_seen(self._pictures[views.cpu()].to(self.style_means.device)))
        means = maps.mean(1)
        return maps, means, self.style(maps - means[:, None])

    def _masks(self, views: Tensor) -> Tensor:
        """Masks [N, h, w] of views [N]."""
        masks: Tensor = self.transients(as_seen(self._larger[views.cpu()].to(self.style_means.device)))
        return masks

    @torch.no_grad()
    def mask(self, view: int, size: Size) -> Plane | None:
        """See MaskedField."""
        if not len(self._larger):
            return None
        mask = self._masks(torch.tensor([view]))
        places = pixel_places(size, mask.device).flatten(0, 1)
        which = torch.zeros(len(places), dtype=torch.int64, device=mask.device)
        return read(mask, which, places).unflatten(0, size).cpu().numpy()

    def shade(self, rays: Rays, samples: Samples, context: TrainingContext | None) -> Rendering:
        """See RadianceModel; without `context` the scene in its mean style."""
        density, features = self.field.geometry(samples.points)
        weights, left = compositing_weights(density, samples.lengths)
        seen = along_ray(weights, self.field.colour(features, rays.viewing))
        colours, extras = self._in_mean_style(seen) if context is None else self._in_styles(seen, context)
        colour = self.over_background(colours * (1 - left[:, None]), left)
        return Rendering(colour, weights, samples, samples.edges, weights, extras=extras)

    def _mean_style(self) -> tuple[Tensor, Tensor]:
        """Of all views, as last visited: S [1, C] and A_s(S0) [1, m, m]."""
        return self.style_means.mean(0, keepdim=True), self.style_matrices.mean(0, keepdim=True)

    def _in_mean_style(self, seen: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Colours [N, 3] of what rays saw [N, C]; a ray's depends on no other ray."""
        style, matrix = self._mean_style()
        return self.transform(seen - self.content_mean, matrix @ self.content_matrix, style), {}

    def _in_styles(self, seen: Tensor, context: TrainingContext) -> tuple[Tensor, dict[str, Tensor]]:
        """Colours [N, 3] of a step's rays, each in its view's style and a few in the mean one, and what is learned by.

        Args:
            seen: features along the rays [N, C].
            context: their views and places.
        """
        content_mean = seen.mean(0)
        centred = seen - content_mean
        content_matrix = self.content(centred[None])[0]
        visited, which = torch.unique_consecutive(context.views, return_inverse=True)
        maps, means, matrices = self._styles(visited)
        extras = self._masked(visited, which, context) | {
            "maps": maps,
            "style_means": means,
            "style_matrices": matrices,
            "content_mean": content_mean,
            "content_matrix": content_matrix,
        }
        style, matrix = self._mean_style()
        as_mean = rays_of_the_mean(len(seen), self.settings.style.mean_share, seen.device)
        which = torch.where(as_mean, len(visited), which)
        transforms = torch.cat([matrices, matrix]) @ content_matrix
        return self.transform(centred, transforms[which], torch.cat([means, style])[which]), extras

    def _masked(self, visited: Tensor, which: Tensor, context: TrainingContext) -> dict[str, Tensor]:
        """Masks of a step's rays, and what masking costs."""
        assert context.places is not None, "batches of `grids` have places"
        m = read(self._masks(visited), which, context.places)
        return {"visited": visited, "m": m, "price": price_of_masking(self.settings.transients, self.running)}

    @torch.no_grad()
    def after_step(self, rendering: Rendering, batch: Batch) -> None:
        """See RadianceModel; keeps the styles, the statistics of the rays and the typical error."""
        extras = rendering.extras
        for kept, of_views in ((self.style_means, "style_means"), (self.style_matrices, "style_matrices")):
            kept[extras["visited"]] = extras[of_views]
        share = max(1 - KEPT, 1 / (1 + float(self.running.steps)))  # the mean of all steps, before there are many
        self.content_mean.lerp_(extras["content_mean"], share)
        self.content_matrix.lerp_(extras["content_matrix"], share)
        errors = (rendering.colour - batch.colours).square().mean(1)
        self.running.observe(errors, extras["m"], batch.weights > 0)
