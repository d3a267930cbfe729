"""Rays from one place in all directions, and photographs of noise: what models of radiance fields are tried on."""

from dataclasses import replace

import numpy as np
import torch

from baselines.training.images import TrainingImages
from baselines.volumetric.compositing import INFINITE
from baselines.volumetric.model import Rendering, Samples, TrainingContext
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.rays import WorldRays
from baselines.volumetric.rays.spaces import Contracted

SPACE = Contracted((0.0, 0.0, 0.0), 1.0, 0.2, 5.0)


def rays(n):
    directions = np.random.default_rng(0).normal(size=(n, 3))
    return SPACE.from_world(WorldRays(np.zeros((n, 3)), directions), torch.device("cpu"))


def batch(n, view=0, colours=0.4):
    """Rays of one view, of one grey, at random places of its photograph."""
    places = torch.rand(n, 2, generator=torch.Generator().manual_seed(0))
    return Batch(rays(n), torch.full((n, 3), colours), torch.ones(n), torch.full((n,), view), places)


def context(of):
    return TrainingContext(of.views, torch.full((2, len(of.views)), 0.5), places=of.places)


def samples(lengths):
    """Samples of rays at places that do not matter, between which lie these lengths [R, S]."""
    count, of_a_ray = lengths.shape
    edges = torch.linspace(0, 1, of_a_ray + 1).expand(count, -1)
    return Samples(edges, lengths, torch.zeros(count, of_a_ray, 3))


def noise(views):
    """Photographs of 32x24 pixels of noise."""
    random = np.random.default_rng(0)
    return TrainingImages([random.integers(0, 256, (24, 32, 3), np.uint8) for _ in range(views)])


def shaded(made, field, lengths, of) -> Rendering:
    """What a model renders of rays where its field is another, whose densities are known."""
    made.field = field
    return made.shade(of.rays, samples(lengths), context(of))


class KnownField(torch.nn.Module):
    """Stands for a field whose densities [R, S] and colours or features [R, C] are known."""

    def __init__(self, density, shown):
        super().__init__()
        self.density, self.shown = torch.nn.Parameter(density), shown

    def geometry(self, points):
        return self.density, torch.zeros(*points.shape[:2], 15)

    def colour(self, features, *_):
        return self.shown[:, None].expand(-1, features.shape[1], -1)


def stays_finite(make, channels, losses, masking):
    """Losses and gradients of rays that meet nothing, are saturated or all the same, where none of them counts, too.

    Args:
        make: gives a model.
        channels: how many its field has.
        losses: of a rendering and a batch.
        masking: the name of the part of a model that masks.
    """
    density = torch.zeros(4, 3)
    density[1], density[2, 0], density[3, 2] = 1e9, 1e30, 1e-30
    lengths = torch.ones(4, 3)
    lengths[:, -1] = INFINITE
    for counts in (1.0, 0.0):
        made, of = make(), replace(batch(4, colours=0.25), weights=torch.full((4,), counts))
        rendering = shaded(made, KnownField(density, torch.full((4, channels), 0.25)), lengths, of)
        terms = losses(rendering, of)
        assert all(torch.isfinite(term) for term in terms.values())
        sum(terms.values()).backward()
        gradients = [parameter.grad for parameter in made.parameters() if parameter.grad is not None]
        assert gradients
        assert all(torch.isfinite(gradient).all() for gradient in gradients)
        made.after_step(rendering, of)
        assert all(torch.isfinite(value).all() for value in made.buffers())
        if not counts:
            assert float(made.field.density.grad.abs().sum()) == 0
            assert all(float(p.grad.abs().sum()) == 0 for p in getattr(made, masking).parameters())


def sees_its_view_or_the_mean(made):
    """A model that takes half of the rays for those of the mean look renders every other ray without its photograph."""
    of = batch(50, view=1)
    with torch.no_grad():
        before = made(of.rays, context(of)).colour
        made._pictures[1] = 255 - made._pictures[1]
        after = made(of.rays, context(of)).colour
    assert ((after - before).abs().amax(1) > 1e-5).tolist() == [i % 2 == 0 for i in range(50)]
