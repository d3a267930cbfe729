"""The appearance model of WildGaussians (Kulhanek et al. 2024, section 3.2): an affine toning of every Gaussian.

A network looks at the embedding e of a view, at the embedding g of a Gaussian and at its base colour c, and gives a
gain and an offset for each channel: in that view the Gaussian has the colour gain * colour + offset from wherever it is
seen. Spherical harmonics are toned exactly: all coefficients take the gain, the first one the rest (`toned`).

Where it deviates from the authors' code: the gain starts at one instead of at zero, so that training starts from the
colours of the points; and the constant 0.5 of the colours takes the gain as well.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import pad

from baselines.splatting.appearance.base import Appearance
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.training.torch_state import module_arrays, restore_module
from baselines.wild_gaussians.sky import Bounds
from hydroviews.scene.cameras import Camera

VIEW_SIZE = 32  # of a view's embedding
FREQUENCIES = 4  # of the Fourier features that Gaussians' embeddings start as
SPREAD = 0.1  # standard deviation of views' embeddings before the first step
MIDDLE = 0.5  # the constant of colours that are spherical harmonics


@dataclass(frozen=True)
class AppearanceConfig:
    """The network and Adam's rates; the defaults are the authors'."""

    width: int = 128  # units of both hidden layers
    scale: float = 0.01  # factor on the output of the network
    rate: float = 5e-4  # learning rate of the network
    view_rate: float = 1e-3  # learning rate of the views' embeddings
    gaussian_rate: float = 5e-3  # learning rate of the Gaussians' embeddings
    final: float = 1.0  # factor of all learning rates at the end


class WildAppearance(Appearance):
    """Two sets of colours a view: toned, which the view shows, and plain."""

    def __init__(self, views: int, bounds: Bounds, iterations: int, config: AppearanceConfig, seed: int) -> None:
        """An appearance that changes next to nothing yet.

        Args:
            views: how many are trained on.
            bounds: of the scene.
            iterations: of the training.
            config: settings.
            seed: of the first weights and embeddings.
        """
        super().__init__()
        self._bounds, self._iterations, self._config = bounds, iterations, config
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.views = nn.Parameter(SPREAD * torch.randn(views, VIEW_SIZE))
            # The first layer in two parts, since every Gaussian of a view shares what comes from the view's embedding.
            self.of_gaussian = nn.Linear(3 + 6 * FREQUENCIES, config.width)
            self.of_view = nn.Linear(VIEW_SIZE, config.width, bias=False)
            self.rest = nn.Sequential(
                nn.ReLU(), nn.Linear(config.width, config.width), nn.ReLU(), nn.Linear(config.width, 6)
            )
        network = [p for name, p in self.named_parameters() if name != "views"]
        self._adam = torch.optim.Adam(
            [{"params": network, "rate": config.rate}, {"params": [self.views], "rate": config.view_rate}], foreach=True
        )

    def features(self, gaussians: Gaussians) -> NDArray[np.float32]:
        """Fourier features [N, 24] of the positions in the scene's bounds."""
        return fourier((gaussians.origin + gaussians.means - self._bounds.centre) / self._bounds.radius)

    def sh_sets(self, parameters: dict[str, Tensor], camera: Camera, view: int, degree: int) -> tuple[Tensor, ...]:
        """See Appearance."""
        sh = parameters["sh"]
        gain, offset = self.change(sh[:, 0], parameters["features"], self.views[view])
        return toned(sh, gain, offset), sh

    def change(self, first: Tensor, features: Tensor, embedding: Tensor) -> tuple[Tensor, Tensor]:
        """Gains and offsets [N, 3] in the view with an embedding [32], of Gaussians with first coefficients [N, 3]."""
        hidden = self.of_gaussian(torch.cat([MIDDLE + C0 * first, features], dim=1)) + self.of_view(embedding)
        gain, offset = (self._config.scale * self.rest(hidden)).split(3, dim=1)
        return 1 + gain, offset

    def learn(self, iteration: int) -> None:
        """See Appearance."""
        for group in self._adam.param_groups:
            group["lr"] = group["rate"] * self._decay(iteration)
        self._adam.step()
        self._adam.zero_grad()

    def feature_rate(self, iteration: int) -> float:
        """See Appearance."""
        return self._config.gaussian_rate * self._decay(iteration)

    def training_state(self) -> dict[str, NDArray]:
        """See Appearance."""
        return module_arrays(self, self._adam)

    def load_training_state(self, arrays: dict[str, NDArray]) -> None:
        """See Appearance."""
        restore_module(self, arrays, self._adam)

    def _decay(self, iteration: int) -> float:
        return math.exp(iteration / max(self._iterations, 1) * math.log(self._config.final))


def fourier(positions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Sines and cosines [N, 24] of positions [N, 3]: [-1, 1] is a period of the lowest of four octaves."""
    turns = math.pi * positions[:, :, None] * 2.0 ** np.arange(FREQUENCIES)
    return np.concatenate([np.sin(turns), np.cos(turns)], axis=2).reshape(len(positions), -1).astype(np.float32)


def toned(sh: Tensor, gain: Tensor, offset: Tensor) -> Tensor:
    """The coefficients [N, K, 3] of gain * colour + offset, where colour = 0.5 + sh . basis, for gains, offsets [N, 3].

    gain (0.5 + sh . basis) + offset = 0.5 + (gain sh) . basis + 0.5 (gain - 1) + offset; what is constant goes to the
    first coefficient, whose basis is C0.
    """
    constant = (MIDDLE * (gain - 1) + offset) / C0
    return torch.addcmul(pad(constant[:, None], (0, 0, 0, sh.shape[1] - 1)), sh, gain[:, None])
