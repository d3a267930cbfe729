"""Colours by view: the seam for methods whose Gaussians look different in every photograph.

Each Gaussian carries `features` beside its usual parameters; they are cloned, split and pruned with it, and the trainer
optimises them. An `Appearance` turns them into the colours of one view: one or several sets of spherical-harmonic
coefficients of the same Gaussians. Each set is rendered, and gradients flow back through the network. It is written in
torch, so that the CPU's kernels and gsplat both can stand at its end.
"""

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from baselines.splatting.gaussians import Gaussians
from hydroviews.scene.cameras import Camera


class Appearance(nn.Module):
    """Colours by view. A module whose own parameters `learn` steps; those of the Gaussians the trainer steps."""

    @abstractmethod
    def features(self, gaussians: Gaussians) -> NDArray[np.float32]:
        """The features [N, F] that the first Gaussians start with."""

    @abstractmethod
    def sh_sets(self, parameters: dict[str, Tensor], camera: Camera, view: int, degree: int) -> tuple[Tensor, ...]:
        """The colours of Gaussians in a view; where they are and what they cover stays as it is.

        Args:
            parameters: of `Gaussians.state_dict()`, of those `in_sight`; means are relative to the Gaussians' origin.
            camera: of the view, relative to that origin as well.
            view: index of the training view.
            degree: of spherical harmonics in use.

        Returns:
            Spherical-harmonic coefficients [n, K, 3]: first of what the view shows, then of what else the objective
            wants to compare, of the same degree.
        """

    @abstractmethod
    def learn(self, iteration: int) -> None:
        """A step of the network's own parameters, whose `.grad` is there; leaves them without gradients."""

    @abstractmethod
    def feature_rate(self, iteration: int) -> float:
        """Adam's learning rate of the features."""

    @abstractmethod
    def training_state(self) -> dict[str, NDArray]:
        """What has been learned beside the Gaussians; see torch_state.module_arrays."""

    @abstractmethod
    def load_training_state(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `training_state` returned."""
