"""Ha-NeRF (Chen et al. 2022): the look of a photograph from the photograph itself, and masks for what comes and goes.

Appearance: a network E turns each photograph into a look, which is given to the colour head (`look`). Occlusions: a
network of a view's code and a place in the picture says what the scene need not explain (`visibility`, `losses`). A
step sees a grid of rays in one photograph (`volumetric.grids`). Held-out views have the mean look of the training
views.

Where this deviates, beside what all radiance fields here share (docs/methods/radiance-fields.md), and why:

* Held-out views are not looked at. The authors take the look of the whole held-out photograph.
* Two losses, that of looks encoded again from what is rendered in another photograph's look, and that of looks that
  are to differ, are left out in all profiles: no look but the mean is rendered here.
* All views are visited in turn instead of drawn at random, and what masking costs falls with the visits of a view
  instead of with steps: 2,100 steps are 130 visits of each of 16 views, 3 of each of 700.
* A grid's offset reaches to the picture's far border. The authors' ends before it: a last strip is never seen.
* Small profiles have the hash grid and proposals that nerf-w has, a smaller encoder, which sees small squares, and a
  smaller mask network. A step has sixteen photographs: one alone pulls the field from view to view. What masking costs
  is a multiple of the running median of the error: at a constant price what is not learned yet is masked for good.
  They colour half of the rays in the mean look, as nerf-w does: what a stretch of views has in common would be missing
  in it otherwise.
* No noise is added to densities, which kept the authors' code from learning some scenes.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import torch

from baselines.ha_nerf.config import PROFILES
from baselines.ha_nerf.losses import ha_nerf_losses
from baselines.ha_nerf.model import HaNerfModel
from baselines.masking.rays import MaskedFieldMethod
from baselines.method import Citation
from baselines.volumetric.losses import Loss
from baselines.volumetric.rays.spaces import Space


class HaNerf(MaskedFieldMethod):
    """Ha-NeRF (Chen et al. 2022): a radiance field with appearance from photographs and masks of transient pixels."""

    citation = Citation(
        title="Ha-NeRF",
        paper="Hallucinated Neural Radiance Fields in the Wild",
        authors="X. Chen, Q. Zhang, X. Li, Y. Chen, Y. Feng, X. Wang, J. Wang",
        year=2022,
        link="https://arxiv.org/abs/2111.15246",
        code="https://github.com/rover-xingyu/Ha-NeRF",
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def make(self, space: Space, generator: torch.Generator, views: int) -> HaNerfModel:
        """See RadianceMethod."""
        return HaNerfModel(self.config, space, generator, views)

    def loss(self) -> Loss:
        """See RadianceMethod."""
        return ha_nerf_losses(self.config)
