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
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any, Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import relu
from tqdm import tqdm

from baselines.splatting.kernels.photometric import Plane
from baselines.training.images import TrainingImages
from baselines.training.torch_state import module_arrays, restore_module
from baselines.wild_gaussians.features import make_features, planes, shrunk
from hydroviews.errors import InputError
from hydroviews.metrics.lpips import MINIMUM_SIZE, activations, weights_of
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

FLAT = 1e-6  # features that vary less are left out
VGG_LEVELS = 3  # of convolutions: 256 channels, a position for 4x4 pixels
Features = Callable[[Image], Tensor]  # a picture [H, W, 3] in [0, 1] to [C, h, w]


@dataclass(frozen=True)
class MaskNetworkConfig:
    """What the network sees, and how it learns; the defaults are the authors'.

    Attributes:
        features: features of the photographs: vgg, alexnet or dinov2.
        lower: share of the residuals that certainly belong to the scene, in (0, upper).
        upper: share of the residuals above which they certainly do not, in (lower, 1].
        width: units of the hidden layer.
        octaves: octaves of the positional encoding.
        rate: learning rate of Adam.
        prior: p before the first step, in (0, 1); None: p of random weights, about 0.5.
    """

    features: Literal["vgg", "alexnet", "dinov2"] = "dinov2"
    lower: float = 0.5
    upper: float = 0.9
    width: int = 16
    octaves: int = 20
    rate: float = 1e-3
    prior: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.lower < self.upper <= 1:
            raise ValueError(f"lower {self.lower}, upper {self.upper}: expected 0 < lower < upper <= 1")
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
            last = nn.Linear(config.width, 1)
            self.layers = nn.Sequential(nn.Linear(inputs, config.width), nn.ReLU(), last)
        if config.prior is not None:
            nn.init.constant_(last.bias, math.log(config.prior / (1 - config.prior)))
        self.layers.to(self._seen[0].device)
        self._adam = torch.optim.Adam(self.layers.parameters(), config.rate)

    def size(self, view: int) -> tuple[int, int]:
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

    def settings(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is another run's."""
        return {**asdict(self.config), "seed": self.seed}

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


def standardise(features: list[Tensor]) -> None:
    """Give features [C, h, w] of pictures mean 0 and deviation 1 over all of them, in half precision, to keep many.

    They are replaced one by one, so that both precisions of all are never there at once. What does not vary, as in
    pictures of one colour, becomes 0.
    """
    number = sum(seen[0].numel() for seen in features)
    mean = sum((seen.double().sum(dim=(1, 2)) for seen in features), torch.zeros(())) / number
    squares = sum(
        ((seen.double() - mean[:, None, None]).square().sum(dim=(1, 2)) for seen in features), torch.zeros(())
    )
    deviation = (squares / number).sqrt()
    factor = torch.where(deviation > FLAT, 1 / deviation.clamp(min=FLAT), 0.0)
    for view, seen in enumerate(features):
        features[view] = ((seen.double() - mean[:, None, None]) * factor[:, None, None]).half()


def enlarged(p: Tensor, size: tuple[int, ...]) -> Plane:
    """p [h, w] of places as a plane of pixels [H, W]."""
    return np.asarray(cv2.resize(p.detach().cpu().numpy(), size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def averaged(plane: NDArray[np.bool_], size: tuple[int, int]) -> Plane:
    """The share [h, w] of true pixels under each position."""
    return np.asarray(cv2.resize(plane.astype(np.float32), size[::-1], interpolation=cv2.INTER_AREA), np.float32)


def frozen(network: Literal["vgg", "alexnet", "dinov2"], device: str) -> Features:
    """A frozen network on a device.

    Raises:
        InputError: its weights can neither be found nor fetched, are not the published ones, or do not fit the memory.
    """
    if network != "vgg":
        return make_features(network, device)
    there = torch.device(device)
    weights_of("vgg", there)  # now rather than at the first picture, so that a lack of them shows early
    return lambda image: vgg_features(image, there)


@torch.no_grad()
def vgg_features(image: Image, device: torch.device) -> Tensor:
    """The last convolution's 256 channels before VGG's third pooling, a position for 4x4 pixels of at most 350 a side.

    Raises:
        InputError: the picture is too small.
    """
    if min(image.shape[:2]) < MINIMUM_SIZE["vgg"]:
        raise InputError(
            "features: the photographs are too small",
            found=f"{image.shape[1]}x{image.shape[0]} pixels",
            expected=f"at least {MINIMUM_SIZE['vgg']} a side",
        )
    return activations("vgg", planes(shrunk(image), device)[None], VGG_LEVELS)[-1][0]
