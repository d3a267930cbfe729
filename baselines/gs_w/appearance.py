"""The Gaussians' colours in a view, from features that the view's own photograph is searched for (GS-W).

A Gaussian has two features. The intrinsic one is its own, and lies where plain splatting has spherical harmonics. The
dynamic one is read from the reference picture's feature maps: from the projection map where the picture shows the
Gaussian, from K adaptive maps at coordinates of its own, which are learned.
"""

from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.gs_w.config import ReferenceConfig
from baselines.gs_w.encoder import ReferenceEncoder
from baselines.gs_w.fusion import Fusion
from baselines.gs_w.sampling import boxed, projected, sample
from baselines.splatting.appearance.base import Appearance
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.schedule import Stream, random_stream
from baselines.training.images import TrainingImages
from baselines.training.torch_state import module_arrays, restore_module
from hydroviews.scene.cameras import Camera

STEPS = "steps"


class ReferenceAppearance(Appearance):
    """Colours in training views. The reference is encoded anew in every step, so that the U-Net learns from each."""

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
        super().__init__()
        self.config, self.seed, self.iterations = config, seed, iterations
        self._images, self._steps = images, 0
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.encoder = ReferenceEncoder(config.backbone, config.dynamic)
            self.fusion = Fusion(config, sh_degree)
        groups = [(self.encoder, config.rate_maps), (self.fusion, config.rate_colour)]
        self._adam = torch.optim.Adam([{"params": list(net.parameters()), "lr": rate} for net, rate in groups])
        self._rates = [rate for _, rate in groups]
        self._outputs: tuple[Tensor, ...] = ()  # of the encoder, with their graph
        self._leaves: tuple[Tensor, ...] = ()  # the same cut off, where gradients gather

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
        if self._absent():
            dynamic = maps.new_zeros(len(parameters["features"]), self.config.dynamic)
        else:
            dynamic = self._dropped(self.read(maps, parameters, camera))
        return (self.fusion.coloured(parameters, camera, dynamic),)

    def read(self, maps: Tensor, parameters: dict[str, Tensor], camera: Camera) -> Tensor:
        """Dynamic features [n, D] of Gaussians in sight, from the maps [D, h, w] of a view and its camera."""
        own = boxed(parameters["features"], self.config.box).unflatten(1, (-1, 2))
        shown = projected(parameters["means"].detach(), camera)
        projection, adaptive = maps.unflatten(0, (1 + self.config.maps, -1)).split([1, self.config.maps])
        return torch.cat([sample(projection, shown[:, None]), sample(adaptive, own)], dim=1)

    def encode(self, view: int) -> tuple[Tensor, Tensor]:
        """The maps [D, h, w] and the visibility mask [h', w'] of a training view."""
        height, width = self._images.pixels(view).shape[:2]
        multiple = self.encoder.multiple
        size = [max(1, round(side / self.config.shrink / multiple)) * multiple for side in (height, width)]
        pixels = self._images.pixels(view, (size[0], size[1])).astype(np.float32) / 255 - 0.5
        picture = torch.from_numpy(pixels).permute(2, 0, 1)[None]
        maps, visible = self.encoder(picture.to(next(self.encoder.parameters()).device))
        return maps, visible

    @torch.no_grad()
    def visibility(self, view: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """m [H, W] of a training view at (height, width)."""
        visible = self.encode(view)[1]
        whole = functional.interpolate(visible[None, None], size=size, mode="bilinear", align_corners=False)[0, 0]
        return whole.clamp(0, 1).cpu().numpy()

    @property
    def visible(self) -> Tensor:
        """m [h', w'] in (0, 1) of the view that `sh_sets` was asked for last; gradients by it are learned from."""
        return self._leaves[1]

    def learn(self, iteration: int) -> None:
        """See Appearance: what has gathered at the encoder's outputs goes through it once, then Adam steps."""
        leaves, outputs = self._leaves, self._outputs
        given = [(out, leaf.grad) for out, leaf in zip(outputs, leaves, strict=True) if leaf.grad is not None]
        if given:
            torch.autograd.backward([out for out, _ in given], [gradient for _, gradient in given])
        for group, rate in zip(self._adam.param_groups, self._rates, strict=True):
            group["lr"] = rate * self._decay(iteration)
        self._adam.step()
        self._adam.zero_grad()
        self._outputs, self._leaves, self._steps = (), (), iteration + 1

    def feature_rate(self, iteration: int) -> float:
        """See Appearance."""
        return self.config.rate_coordinates * self._decay(iteration)

    def settings(self) -> dict[str, Any]:
        """See Appearance."""
        return {**super().settings(), "seed": self.seed, "iterations": self.iterations, **asdict(self.config)}

    def training_state(self) -> dict[str, NDArray]:
        """See Appearance."""
        return {**module_arrays(self, self._adam), STEPS: np.array([self._steps])}

    def load_training_state(self, arrays: dict[str, NDArray]) -> None:
        """See Appearance."""
        restore_module(self, arrays, self._adam)
        self._steps = int(arrays[STEPS][0])

    def _encoded(self, view: int) -> tuple[Tensor, ...]:
        """What `encode` returns, cut off from its graph so that several losses send one gradient through it."""
        self._outputs = self.encode(view)
        self._leaves = tuple(output.detach().requires_grad_() for output in self._outputs)
        return self._leaves

    def _absent(self) -> bool:
        """Is this one of the steps that have nothing of the maps? The same whenever it is done again."""
        drawn = random_stream(self.seed, Stream.ABSENCE, self._steps).random()
        return torch.is_grad_enabled() and drawn < self.config.absent

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

    def _decay(self, iteration: int) -> float:
        return float(self.config.final ** (iteration / max(self.iterations, 1)))
