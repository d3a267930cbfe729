"""A network that tells from frozen features which places of the photographs show the scene (SpotLessSplats' SLS-mlp).

    p = sigmoid(MLP(features, positional encoding)),      loss = mean(relu(p - U) + relu(L - p))

(Sabour et al. 2025, section 4.2.2). L and U are the inliers below a lower and a higher percentile of the residuals: p
is to be 1 where the residual is small, 0 where it is large, and free in between, where what looks alike decides. The
network is shared by all views and has a step of its own in every step of the Gaussians.

Departures: frozen features are VGG's (LPIPS' weights) in short profiles and DINOv2's in `paper`, the authors' are
diffusion features; they are standardised over all photographs; p is predicted, and compared, at their resolution,
not at the picture's. The authors' regulariser has no gradient, and is left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import relu
from tqdm import tqdm

from baselines.encoders.frozen import Features, Network, standardise
from baselines.masking.trimmed import TrimConfig, TrimmedPixels
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.photometric import Plane
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import Size, TrainingImages
from baselines.training.torch_state import module_arrays, one_thread, restore_module
from hydroviews.scene.masks import Ignored

HIDDEN = 16  # units of the hidden layer; the authors'
# Shares of the residuals below which they certainly belong to the scene, and above which they certainly do not; the
# authors'.
LOWER, UPPER = 0.5, 0.9


@dataclass(frozen=True)
class MaskNetworkConfig:
    """What the network sees, and how it learns; the defaults are the authors'.

    Attributes:
        features: features of the photographs: vgg, alexnet or dinov2.
        octaves: octaves of the positional encoding.
        rate: learning rate of Adam.
        prior: p before the first step, in (0, 1); None: p of random weights, about 0.5.
    """

    features: Network = "dinov2"
    octaves: int = 20
    rate: float = 1e-3
    prior: float | None = None

    def __post_init__(self) -> None:
        if self.prior is not None and not 0 < self.prior < 1:
            raise ValueError(f"prior {self.prior}: expected a probability in (0, 1)")


class MaskNetwork:
    """Predicts p of a scene's training views, and learns to."""

    def __init__(
        self, images: TrainingImages, features: Features, config: MaskNetworkConfig, seed: int, extra: int = 0
    ) -> None:
        """Look at all photographs, showing progress.

        Args:
            images: the photographs.
            features: what is seen of them.
            config: settings.
            seed: of the first weights.
            extra: planes that `learn` is given beside.
        """
        self.config, self.seed = config, seed
        pictures = tqdm(range(len(images)), desc="features of the photographs", unit="image", leave=False)
        self._seen = [features(images.pixels(view) / np.float32(255)) for view in pictures]
        standardise(self._seen)
        inputs = len(self._seen[0]) + 4 * config.octaves + extra
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            last = nn.Linear(HIDDEN, 1)
            self.layers = nn.Sequential(nn.Linear(inputs, HIDDEN), nn.ReLU(), last)
        if config.prior is not None:
            nn.init.constant_(last.bias, math.log(config.prior / (1 - config.prior)))
        self.layers.to(self._seen[0].device)
        self._adam = torch.optim.Adam(self.layers.parameters(), config.rate)

    def size(self, view: int) -> Size:
        """Height and width of a view's features."""
        return self._seen[view].shape[1], self._seen[view].shape[2]

    def learn(
        self,
        view: int,
        lower: NDArray[np.bool_],
        upper: NDArray[np.bool_],
        ignored: Ignored | None = None,
        extra: Sequence[Plane] = (),
    ) -> Plane:
        """p [H, W] in [0, 1] of a view as it was predicted, and a step towards the inliers.

        Args:
            view: its index.
            lower: L [H, W], inliers below the lower percentile, at any size of the view.
            upper: U [H, W].
            ignored: what is hidden of it [H, W], from which nothing is learned.
            extra: what else the network sees, at the size of the features.
        """
        p = self._predict(view, extra)
        shown = np.ones(lower.shape, np.bool_) if ignored is None else ~ignored
        planes_at_features = (averaged(plane, self.size(view)) for plane in (lower, upper, shown))
        low, high, counts = (torch.from_numpy(plane).to(p) for plane in planes_at_features)
        (hinge(p, low, high) * counts).mean().backward()
        self._adam.step()
        self._adam.zero_grad()
        return enlarged(p, lower.shape)

    def probability(self, view: int, size: tuple[int, ...], extra: Sequence[Plane] = ()) -> Plane:
        """p [H, W] in [0, 1] of a view at a size; nothing is learned."""
        with torch.no_grad():
            return enlarged(self._predict(view, extra), size)

    def state_dict(self) -> dict[str, NDArray]:
        """What was learned."""
        return module_arrays(self.layers, self._adam)

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        restore_module(self.layers, arrays, self._adam)

    def _predict(self, view: int, extra: Sequence[Plane]) -> Tensor:
        """p [h, w] at the size of the features."""
        seen = self._seen[view]
        height, width = self.size(view)
        columns = [seen.flatten(1).T.float(), encoded_places(height, width, self.config.octaves).to(seen.device)]
        columns += [torch.from_numpy(plane).to(seen.device).reshape(-1, 1) for plane in extra]
        return torch.sigmoid(self.layers(torch.cat(columns, dim=1))[:, 0]).reshape(height, width)


def hinge(p: Tensor, lower: Tensor, upper: Tensor) -> Tensor:
    """relu(p - U) + relu(L - p), unreduced."""
    return relu(p - upper) + relu(lower - p)


@cache
def encoded_places(height: int, width: int, octaves: int) -> Tensor:
    """sin and cos of 2^k y and 2^k x, for k below `octaves`, [h w, 4 octaves]; y, x in [0, 1] over the picture."""
    y, x = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    angles = np.stack([y, x], axis=-1).reshape(-1, 2, 1) * 2.0 ** np.arange(octaves)
    encoded = np.concatenate([np.sin(angles), np.cos(angles)], axis=1).reshape(height * width, -1)
    return torch.from_numpy(encoded.astype(np.float32))


def enlarged(p: Tensor, size: tuple[int, ...]) -> Plane:
    """p [h, w] of places as a plane of pixels [H, W]."""
    return np.asarray(cv2.resize(p.detach().cpu().numpy(), size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def averaged(plane: NDArray[np.bool_], size: Size) -> Plane:
    """The share [h, w] of true pixels under each position."""
    return np.asarray(cv2.resize(plane.astype(np.float32), size[::-1], interpolation=cv2.INTER_AREA), np.float32)


class FeatureMask(TrimmedPixels):
    """Weights by what the network takes for the scene's (SpotLessSplats)."""

    extra: ClassVar[int] = 0  # planes of `context`

    def __init__(
        self, images: TrainingImages, trim: TrimConfig, splatting: TrainerConfig, network: MaskNetwork, seed: int
    ) -> None:
        """See TrimmedPixels; with a network that was made for the same images."""
        super().__init__(images, trim, splatting, seed)
        self.network = network

    def probability(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """See TrimmedPixels; the network takes a step."""
        lower, upper = (self.below(residuals, share, ignored) for share in (LOWER, UPPER))
        with one_thread():
            return self.network.learn(view, lower, upper, ignored, self.context(view))

    def predicted(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """See TrimmedPixels."""
        with one_thread():
            return self.network.probability(view, residuals.shape, self.context(view))

    def context(self, view: int) -> Sequence[Plane]:
        """Planes that the network receives of a view beside its features; none here."""
        return ()

    def report(self) -> dict[str, Any]:
        """See PixelWeights; the features that the network saw as well."""
        return {"features": self.network.config.features, **super().report()}

    def state_dict(self) -> dict[str, NDArray]:
        """See PixelWeights."""
        return super().state_dict() | prefixed("network", self.network.state_dict())

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See PixelWeights."""
        super().load_state_dict(arrays)
        self.network.load_state_dict(below("network", arrays))
