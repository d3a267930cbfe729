"""Where a photograph shows what is not of the scene (WildGaussians, Kulhanek et al. 2024, section 3.3).

A layer on frozen features of the photograph predicts an uncertainty u. It learns from how unlike the render's features
are to the photograph's, d in [0, 1],

    L = mean(d / (2 u^2)) + lambda mean(log u),      smallest at u = sqrt(d / lambda)

and a pixel's photometric loss counts if 1 / (2 u^2) > 1, and else not at all: with lambda = 0.5, where d < 1/4. What
looks alike to the features has one u, in all views.

Where it deviates from the authors' code: features are standardised by their statistics over all training photographs,
which are known before the training, where theirs are of the batch of one picture; L is taken at the features'
resolution; dropout is for learning only, not for the weights; features of photograph and render have one size.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import interpolate, softplus
from tqdm import tqdm

from baselines.encoders.frozen import CalibratedFeatures, CalibratedNetwork, unlikeness
from baselines.masking.pixel_weights import Comparison, PixelWeights
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting.schedule import Stream, random_stream
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.images import Size, TrainingImages
from baselines.training.torch_state import module_arrays, restore_module
from hydroviews.scene.images import Image

REGULARISER, DROPOUT = 0.5, 0.5  # lambda, and the share of the features that a lesson drops; the authors'
FLAT = 1e-6  # features that vary less are left out
CHANNELS = 16  # of which all pictures' features are gathered at once


@dataclass(frozen=True)
class UncertaintyConfig:
    """Settings; the defaults are the authors'. Iterations count from 0."""

    features: CalibratedNetwork = "dinov2"  # features of the pictures: dinov2, as in the paper, or alexnet
    start: int = 10_000  # iteration before which all pixels count
    warm_up: int = 1800  # iterations in which the weights change from 1 to the predicted ones
    protected: int = 500  # iterations after an opacity reset without training of the uncertainty
    first_lesson: int = 0  # iteration of the first training of the uncertainty
    every: int = 1  # iterations between two trainings of the uncertainty
    rate: float = 1e-3  # learning rate of Adam
    prior: float = 1.0  # u before the first training
    least: float = 0.1  # smallest u; pixels with u below 0.71 count


class Uncertainty(PixelWeights):
    """Predicts the uncertainties of a scene's training views, and learns to."""

    def __init__(
        self,
        images: TrainingImages,
        features: CalibratedFeatures,
        config: UncertaintyConfig,
        strategy: DefaultStrategy | MCMCStrategy,
        seed: int,
    ) -> None:
        """Look at all photographs, showing progress.

        Args:
            images: the photographs.
            features: what is seen of them.
            config: settings.
            strategy: says when opacities are reset.
            seed: of the first weights and of dropout.
        """
        self.images, self.features, self.config, self.seed = images, features, config, seed
        self._resets = strategy.reset_every if isinstance(strategy, DefaultStrategy) else None
        self._last = strategy.stop
        pictures = tqdm(range(len(images)), desc="features of the photographs", unit="image", leave=False)
        self._seen = [features(images.pixels(view) / np.float32(255)) for view in pictures]
        self._mean, deviation = statistics(self._seen)
        self._factor = torch.where(deviation > FLAT, 1 / deviation.clamp(min=FLAT), 0.0)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.head = nn.Linear(len(self._mean), 1)
            nn.init.normal_(self.head.weight, 0, 0.01)
            nn.init.constant_(self.head.bias, math.log(math.expm1(config.prior)))  # softplus of it is the prior
        self.head.to(self._mean.device)
        self._adam = torch.optim.Adam(self.head.parameters(), config.rate)

    def weigh(self, seen: Comparison) -> Plane | None:
        """See PixelWeights; the uncertainty then learns from the render."""
        weights = self.weights(seen.view, seen.size, seen.iteration)
        self.learn(seen.render(), seen.view, seen.iteration)
        return weights

    def hidden(self, view: int, size: Size, render: Callable[[], Image]) -> Plane:
        """See PixelWeights: 1 where a pixel does not count."""
        return (~counted(self.uncertainty(view, size))).astype(np.float32)

    def report(self) -> dict[str, str]:
        """See PixelWeights: the network of the features."""
        return {"uncertainty": self.features.name}

    def masked(self, iteration: int) -> float:
        """Share of the photographs' pixels that do not count at an iteration, in the mean over views."""
        shares = []
        for view in range(len(self.images)):
            height, width = self.images.pixels(view).shape[:2]
            weights = self.weights(view, (height, width), iteration)
            shares.append(0.0 if weights is None else 1 - float(weights.mean()))
        return float(np.mean(shares))

    def weights(self, view: int, size: Size, iteration: int) -> Plane | None:
        """Factors on the photometric loss of a view's pixels, [H, W] in [0, 1]; None while all are 1."""
        strength = warmed(iteration, self.config)
        if not strength:
            return None
        return (1 - strength * ~counted(self.uncertainty(view, size))).astype(np.float32)

    @torch.no_grad()
    def uncertainty(self, view: int, size: Size) -> NDArray[np.float32]:
        """u of a view's pixels, [H, W], at least `config.least`."""
        u = interpolate(self._predict(view)[None, None], size=size, mode="bilinear")[0, 0]
        return u.clamp(min=self.config.least).cpu().numpy()

    def learn(self, image: Image, view: int, iteration: int) -> None:
        """A step towards how unlike the photograph a render [H, W, 3] of its view is, if one is due."""
        config = self.config
        if iteration < config.first_lesson or iteration % config.every or self.is_protected(iteration):
            return
        ignored = self.images.ignored(view, (image.shape[0], image.shape[1]))
        image = image if ignored is None else np.where(ignored[..., None], np.float32(0), image)  # as in the photograph
        unlike = self.unlike(image, view)
        u = self._predict(view, self._dropped(iteration)).clamp(min=config.least)
        loss = (uncertainty_loss(unlike, u, REGULARISER) * self._shown(view, u)).mean()
        loss.backward()
        self._adam.step()
        self._adam.zero_grad()

    def unlike(self, image: Image, view: int) -> Tensor:
        """d [h, w] in [0, 1]: how unlike the photograph a render [H, W, 3] of a view is."""
        full = self.images.pixels(view).shape
        if image.shape != full:
            image = np.asarray(cv2.resize(image, (full[1], full[0]), interpolation=cv2.INTER_LINEAR), np.float32)
        found = unlikeness(self.features(np.clip(image, 0, 1)), self._seen[view])
        return ((found - self.features.alike) / (self.features.unlike - self.features.alike)).clamp(0, 1)

    def is_protected(self, iteration: int) -> bool:
        """Whether opacities were reset so short a time ago that renders are not to be learned from."""
        if self._resets is None or iteration < self._resets:
            return False
        latest = min(iteration, self._last - 1) // self._resets * self._resets
        return iteration - latest < self.config.protected

    def state_dict(self) -> dict[str, NDArray]:
        """See PixelWeights."""
        return module_arrays(self.head, self._adam)

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See PixelWeights."""
        restore_module(self.head, arrays, self._adam)

    def _predict(self, view: int, factors: Tensor | float = 1.0) -> Tensor:
        """u [h, w] without a floor; `factors` [C, 1, 1] leave features out."""
        standard = (self._seen[view] - self._mean) * self._factor * factors
        return softplus(self.head(standard.permute(1, 2, 0))[..., 0])

    def _dropped(self, iteration: int) -> Tensor:
        """Factors [C, 1, 1] that leave some of the features out, and make up for it."""
        kept = random_stream(self.seed, Stream.DROPOUT, iteration).random(self.head.in_features) >= DROPOUT
        return torch.from_numpy(kept / (1 - DROPOUT)).to(self._mean)[:, None, None]

    def _shown(self, view: int, like: Tensor) -> Tensor | float:
        """The shares of the features' positions [h, w] that are not hidden."""
        ignored = self.images.ignored(view)
        if ignored is None:
            return 1.0
        size = like.shape[1], like.shape[0]
        return torch.from_numpy(cv2.resize((~ignored).astype(np.float32), size, interpolation=cv2.INTER_AREA)).to(like)


def statistics(features: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Mean and deviation [C, 1, 1] of features [C, h, w] over all pictures; few channels at a time, to spare memory."""
    parts = []
    for some in zip(*(seen.split(CHANNELS) for seen in features), strict=True):
        everywhere = torch.cat([seen.flatten(1) for seen in some], dim=1)
        parts.append(torch.stack([everywhere.mean(dim=1), everywhere.std(dim=1)]))
    mean, deviation = torch.cat(parts, dim=1)[..., None, None]
    return mean, deviation


def uncertainty_loss(unlike: Tensor, u: Tensor, regulariser: float) -> Tensor:
    """d / (2 u^2) + lambda log u, unreduced."""
    return unlike / (2 * u**2) + regulariser * u.log()


def counted(u: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which pixels count: 1 / (2 u^2) > 1."""
    return 2 * u**2 < 1


def warmed(iteration: int, config: UncertaintyConfig) -> float:
    """How far the weights have turned from 1 to those predicted, [0, 1]."""
    return min(1.0, max(0.0, (iteration - config.start) / max(config.warm_up, 1)))
