"""A radiance field that is rendered along rays: samples, shading, compositing. Methods derive from it."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from baselines.training.images import TrainingImages
from baselines.volumetric.compositing import along_ray, compositing_weights, interval_lengths
from baselines.volumetric.config import HashFieldConfig, VolumetricConfig
from baselines.volumetric.fields.fields import HashField, MlpField, ProposalNetwork
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.rays import camera_rays
from baselines.volumetric.rays.sampling import even_edges, resample
from baselines.volumetric.rays.spaces import Rays, Space
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

CHUNK, GPU_CHUNK = 2**17, 2**20  # samples that are rendered at once: what bounds the memory


@dataclass(frozen=True)
class TrainingContext:
    """What rendering depends on in a step of training alone."""

    views: Tensor  # index of the training view [R] that each ray belongs to
    jitter: Tensor  # [2, R] in [0, 1), of the proposal's and of the field's samples
    sharpness: float = 1.0  # exponent of the proposal's weights
    update_proposal: bool = True  # whether the proposal network learns
    places: Tensor | None = None  # of the pixels, see Batch
    progress: float = 0.0  # share of the steps that are done


@dataclass(frozen=True)
class Samples:
    """Intervals along R rays."""

    edges: Tensor  # [R, S + 1] in [0, 1]
    lengths: Tensor  # [R, S]
    points: Tensor  # [R, S, 3], the intervals' middles in the unit cube


@dataclass(frozen=True)
class Rendering:
    """What was seen along R rays, and how."""

    colour: Tensor  # [R, 3]
    weights: Tensor  # [R, S]
    samples: Samples
    proposal_edges: Tensor  # [R, P + 1]
    proposal_weights: Tensor  # [R, P]
    coarse_colour: Tensor | None = None  # [R, 3], where a coarse field proposes the samples
    extras: dict[str, Tensor] = field(default_factory=dict)  # what a method's loss needs besides


class RadianceModel(nn.Module):
    """A field, and the network that proposes its samples, in a space."""

    def __init__(
        self,
        config: VolumetricConfig,
        space: Space,
        generator: torch.Generator,
        embedding_size: int = 0,
        channels: int = 3,
    ):
        """Random start.

        Args:
            config: settings.
            space: of the scene.
            generator: of the start, on the CPU.
            embedding_size: length of the embedding that a ray's colour depends on beside its direction.
            channels: of what the field gives for a colour; a coarse field gives three.
        """
        super().__init__()
        self.config, self.space = config, space
        self.field: HashField | MlpField
        self.proposal: ProposalNetwork | MlpField
        if isinstance(config.field, HashFieldConfig):
            self.field = HashField(config.field, embedding_size, generator, channels)
            self.proposal = ProposalNetwork(config.field, generator)
        else:
            self.field = MlpField(config.field, embedding_size, generator, channels)
            self.proposal = MlpField(config.field, 0, generator)

    def forward(self, rays: Rays, context: TrainingContext | None = None) -> Rendering:
        """Render rays; with `context` as a step of training does, without it as the scene is to be shown."""
        edges, weights, coarse = self._propose(rays, context)
        jitter = None if context is None else context.jitter[1]
        sharpness = 1.0 if context is None else context.sharpness
        fine = resample(edges, weights.detach(), self.config.samples, jitter, sharpness)
        if coarse is not None:  # NeRF evaluates the fine field at the coarse samples as well
            fine = torch.sort(torch.cat([fine, edges[:, 1:-1]], 1), 1).values
        rendering = self.shade(rays, self.place(rays, fine), context)
        return replace(rendering, proposal_edges=edges, proposal_weights=weights, coarse_colour=coarse)

    def shade(self, rays: Rays, samples: Samples, context: TrainingContext | None) -> Rendering:
        """Field and compositing; the part that methods replace."""
        return self.composited(self.field, rays, samples)[0]

    def composited(
        self, field: HashField | MlpField, rays: Rays, samples: Samples, embeddings: Tensor | None = None
    ) -> tuple[Rendering, Tensor]:
        """What one field shows, with embeddings [R, E] of the views if it takes any, and its densities [R, S]."""
        density, features = field.geometry(samples.points)
        weights, left = compositing_weights(density, samples.lengths)
        seen = along_ray(weights, field.colour(features, rays.viewing, embeddings))
        colour = self.over_background(seen, left)
        return Rendering(colour, weights, samples, samples.edges, weights), density

    def over_background(self, colour: Tensor, left: Tensor) -> Tensor:
        """Colours [R, 3] with the background behind them, of which a share [R] is seen."""
        if self.config.background is None:
            return colour
        return colour + left[:, None] * torch.tensor(self.config.background, device=colour.device)

    def place(self, rays: Rays, edges: Tensor) -> Samples:
        """The intervals between edges [R, S + 1] in [0, 1]."""
        t = self.space.s_to_t(edges)
        middles = (t[:, 1:] + t[:, :-1]) / 2
        open_end = self.config.background is None
        if open_end:  # the last interval stands for all that is far away: the sky has no parallax
            middles = torch.cat([middles[:, :-1], torch.full_like(middles[:, :1], self.space.horizon)], 1)
        lengths = interval_lengths(t, rays.directions, open_end)
        return Samples(edges, lengths, self.space.to_unit_cube(rays.points(middles)))

    def _propose(self, rays: Rays, context: TrainingContext | None) -> tuple[Tensor, Tensor, Tensor | None]:
        """The proposal's histogram: edges [R, P + 1], weights [R, P], and colours [R, 3] of a coarse field."""
        count, device = len(rays.origins), rays.origins.device
        jitter = None if context is None else context.jitter[0]
        samples = self.place(rays, even_edges(count, self.config.proposal_samples, jitter, device))
        with torch.set_grad_enabled(torch.is_grad_enabled() and (context is None or context.update_proposal)):
            if isinstance(self.proposal, ProposalNetwork):
                density = self.proposal.density(samples.points)
                return samples.edges, compositing_weights(density, samples.lengths)[0], None
            coarse, _ = self.composited(self.proposal, rays, samples)
            return samples.edges, coarse.weights, coarse.colour

    def groups(self) -> list[dict[str, Any]]:
        """Parameters for Adam, each with its learning rate."""
        return [{"params": list(self.parameters()), "lr": self.config.field.rate}]

    def prepare(self, images: TrainingImages) -> None:
        """Before training: keep what is needed of the photographs; here nothing."""

    def after_step(self, rendering: Rendering, batch: Batch) -> None:
        """After a step of training: update what its buffers keep of the step; here nothing."""

    def finish(self) -> None:
        """After training: calculate what rendering needs of all views; here nothing."""

    def chunks(self, rays: Rays) -> Iterator[Rays]:
        """The rays in parts that fit into a bounded memory."""
        chunk = GPU_CHUNK if rays.origins.is_cuda else CHUNK
        step = max(1, chunk // (self.config.samples + self.config.proposal_samples))
        for start in range(0, len(rays.origins), step):
            yield rays.part(start, start + step)

    @torch.no_grad()
    def render(self, camera: Camera) -> Image:
        """What a camera sees: float32 [H, W, 3] in [0, 1]."""
        rays = self.space.from_world(camera_rays(camera), next(self.parameters()).device)
        colours = torch.cat([self(part).colour for part in self.chunks(rays)])
        image: Image = colours.clamp(0, 1).view(camera.height, camera.width, 3).cpu().numpy().astype(np.float32)
        return image
