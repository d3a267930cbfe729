"""The Gaussians' colours in a view, from features that the view's own photograph is searched for (GS-W).

A Gaussian has two features. The intrinsic one is its own, and lies where plain splatting has spherical harmonics. The
dynamic one is read from the reference picture's feature maps: from the projection map where the picture shows the
Gaussian, from K adaptive maps at coordinates of its own, which are learned.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.encoders.appearance import EncodedAppearance
from baselines.encoders.sampling import boxed, projected, sample
from baselines.gs_w.config import ReferenceConfig
from baselines.gs_w.encoder import ReferenceEncoder
from baselines.gs_w.fusion import Fusion
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.schedule import Stream, random_stream
from baselines.training.images import TrainingImages
from hydroviews.scene.cameras import Camera

BOX_WEIGHT = 1e-3  # of mean(relu(|coordinate| - 1)) in the loss (the authors)


class ReferenceAppearance(EncodedAppearance):
    """Colours in training views, from the reference's feature maps [D, h, w]."""

    config: ReferenceConfig
    encoder: ReferenceEncoder

    def __init__(
        self, images: TrainingImages, config: ReferenceConfig, sh_degree: int, iterations: int, seed: int
    ) -> None:
        """Start with networks that leave colours as they are.

        Args:
            images: the references.
            config: settings.
            sh_degree: gives the intrinsic feature's length, 3 (sh_degree + 1)^2.
            iterations: of the whole training.
            seed: of the first weights, the first coordinates, and what is dropped.
        """
        super().__init__(images, config, iterations, seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.encoder = ReferenceEncoder(config.backbone, config.dynamic)
            self.fusion = Fusion(config, sh_degree)
        self.optimise([(self.encoder, config.rate_maps), (self.fusion, config.rate_colour)])

    def visible_price(self, iteration: int) -> float:
        """See EncodedAppearance: always the same."""
        return self.config.visible_price

    def features(self, gaussians: Gaussians) -> NDArray[np.float32]:
        """See Appearance: coordinates [N, 2 K], each a random mixture of the three of the position in its cube."""
        self.fusion.enclose(gaussians.means)
        mixtures = np.random.default_rng(self.seed).uniform(size=(2 * self.config.maps, 3))
        mixtures /= mixtures.sum(axis=1, keepdims=True)
        positions = (gaussians.means - self.fusion.middle.cpu().numpy()) / self.fusion.side.item()
        return np.ascontiguousarray(np.clip(positions, -1, 1) @ mixtures.T, np.float32)

    def sh_sets(self, parameters: dict[str, Tensor], camera: Camera, view: int, degree: int) -> tuple[Tensor, ...]:
        """See Appearance; one set."""
        maps = self._encoded(view)[0]  # which finds the visibility mask too
        dynamic = None if self._absent() else self._dropped(self.read(maps, parameters, camera))
        return (self.fusion.coloured(parameters, camera, dynamic),)

    def read(self, maps: Tensor, parameters: dict[str, Tensor], camera: Camera) -> Tensor:
        """Dynamic features [n, D] of Gaussians in sight, from the maps [D, h, w] of a view and its camera."""
        own = boxed(parameters["features"], BOX_WEIGHT).unflatten(1, (-1, 2))
        shown = projected(parameters["means"].detach(), camera)
        projection, adaptive = maps.unflatten(0, (1 + self.config.maps, -1)).split([1, self.config.maps])
        return torch.cat([sample(projection, shown[:, None]), sample(adaptive, own)], dim=1)

    def feature_rate(self, iteration: int) -> float:
        """See Appearance."""
        return self.config.rate_coordinates * self._decay(iteration)

    def _dropped(self, dynamic: Tensor) -> Tensor:
        """Dropout (Srivastava et al. 2014) of what Gaussians have of a map; none where nothing is learned.

        The same whenever a step is done again. What is left is scaled so that features, with those of steps that have
        none of them, are the same in the mean.
        """
        if not torch.is_grad_enabled():
            return dynamic
        config = self.config
        parts = dynamic.unflatten(1, (1 + config.maps, -1))
        drawn = random_stream(self.seed, Stream.DROPOUT, self._steps).random((*parts.shape[:2], 1), np.float32)
        kept = torch.from_numpy(drawn >= config.dropout).to(dynamic)
        return (parts * (kept / ((1 - config.dropout) * (1 - config.absent)))).flatten(1)
