"""The protocol of pixel weights: factors on each pixel's share of the loss, learned with the scene or computed.

An objective that has pixel weights asks for them once a step, and keeps their state in its checkpoint.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from baselines.splatting.kernels.photometric import Plane, Target
from baselines.training.images import Size
from hydroviews.scene.images import Image


@dataclass(frozen=True)
class Comparison:
    """A training view and its render, as one step of a training compares them.

    Attributes:
        view: index of the training view.
        iteration: of the training.
        target: the photograph at the size of the render, and which pixels its mask hides.
        render: gives the rendered view [H, W, 3], which a GPU then has to hand over.
        losses: gives what each pixel adds to the loss before it is weighed [H, W].
    """

    view: int
    iteration: int
    target: Target
    render: Callable[[], Image]
    losses: Callable[[], Plane]

    @property
    def size(self) -> Size:
        """Height and width."""
        return self.target.pixels.shape[0], self.target.pixels.shape[1]


class PixelWeights(ABC):
    """Weights of the pixels of a scene's training views."""

    @abstractmethod
    def weigh(self, seen: Comparison) -> Plane | None:
        """Factors [H, W] in [0, 1] on the pixels of a view in this step; None where all are 1.

        Weights that are learned take their own step here.
        """

    @abstractmethod
    def hidden(self, view: int, size: Size, render: Callable[[], Image]) -> Plane | None:
        """How far each pixel [H, W] of a view is taken for something else than the scene, [0, 1], after training.

        Nothing is learned. None where all pixels count.

        Args:
            view: index of the training view.
            size: height and width.
            render: gives the view of the trained scene [H, W, 3].
        """

    def report(self) -> dict[str, Any]:
        """For the record: words, numbers or lists of words."""
        return {}

    def state_dict(self) -> dict[str, NDArray]:
        """What was learned, for a checkpoint."""
        return {}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        assert not arrays, f"{type(self).__name__} keeps no state"
