"""CR-NeRF (Yang et al. 2023): colours by a transform across rays, and masks of what looks like passing by.

Appearance: the field has features instead of colours; those that rays have composited are turned into colours by a
linear map that depends on their covariance and on that of a style map of the photograph (`transform`, `style`).
Occlusions: a network of the photograph says what the scene need not explain (`transients`). A step sees a grid of rays
in one photograph (`volumetric.grids`). Held-out views have the mean style of the training views.

Where this deviates, beside what all radiance fields here share (docs/methods/radiance-fields.md), and why:

* Held-out views are not looked at. The authors take the style of the whole held-out photograph.
* A render takes mean and matrix of the features from the training steps, as running averages. The authors take those of
  the picture that is rendered, so that a pixel depends on what else is in the picture.
* Two losses are left out in all profiles, that of style maps encoded again from what is rendered in another style, and
  that of content encoded from what is rendered in two styles: no style but the mean is rendered here.
* Matrices start as the identity instead of at random: a field learns what it is to show from the first step on.
* The coarse network of the paper profile gives colours, without transform, as in Ha-NeRF. Its masks are those of plain
  dilated convolutions, without CGNet's blocks.
* Small profiles have the hash grid and proposals that nerf-w has, fewer features, smaller matrices and networks, which
  see small squares. As in ha-nerf here, a step has sixteen photographs, of whose features the statistics are taken
  together, half of the rays have the mean style, and no noise is added to densities.
* Their price of masking is a multiple of the running mean of the error: at a constant price what is not learned yet is
  masked for good, at one of the median everything that is hard to learn.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import torch

from baselines.cr_nerf.config import PROFILES
from baselines.cr_nerf.losses import cr_nerf_losses
from baselines.cr_nerf.model import CrNerfModel
from baselines.masking.rays import MaskedFieldMethod
from baselines.method import Citation
from baselines.volumetric.losses import Loss
from baselines.volumetric.rays.spaces import Space


class CrNerf(MaskedFieldMethod):
    """CR-NeRF (Yang et al. 2023): a field of features; colours depend on all rays and the style of a photograph."""

    citation = Citation(
        title="CR-NeRF",
        paper="Cross-Ray Neural Radiance Fields for Novel-view Synthesis from Unconstrained Image Collections",
        authors="Y. Yang, S. Zhang, Z. Huang, Y. Zhang, M. Tan",
        year=2023,
        link="https://arxiv.org/abs/2307.08093",
        code="https://github.com/YifYang993/CR-NeRF-PyTorch",
        licence="BSD-3-Clause",
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def make(self, space: Space, generator: torch.Generator, views: int) -> CrNerfModel:
        """See RadianceMethod."""
        return CrNerfModel(self.config, space, generator, views)

    def loss(self) -> Loss:
        """See RadianceMethod."""
        return cr_nerf_losses(self.config)
