"""An enhancement network of which a test sets the predictions, in place of `EnhancedViews`."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.training.images import TrainingImages
from deraings.lens.mist_prior import NetworkMist
from hydroviews.scene.images import to_uint8

Plane = NDArray[np.float32]


class PretendedNetwork:
    """Predicts what it is given, and counts what it is asked.

    Attributes:
        asked: views whose enhanced picture was asked for.
        finds_rain: whether it finds any; a test may change it.
        read: how often all enhanced pictures were.
    """

    digest = "of a test"
    finds_rain = True

    def __init__(
        self,
        pictures: Sequence[NDArray[np.float32]] = (),
        covers: Sequence[Plane] | None = None,
        mist: NetworkMist | None = None,
        change: Callable[[int], float] = lambda _: 0.0,
        error: Plane | None = None,
        hidden: Sequence[NDArray[np.bool_] | None] = (),
        photographs: Sequence[NDArray[np.float32]] = (),
    ) -> None:
        """A network.

        Args:
            pictures: enhanced photographs [H, W, 3].
            covers: what drops cover of each [h, w]; None: it predicts no cover.
            mist: on the lens of all of them.
            change: what it changes over its error, [0, 1], by view.
            error: that it expects of each picture [h, w].
            hidden: masks [H, W] of the photographs.
            photographs: without their mist [H, W, 3].
        """
        self.pictures = [to_uint8(picture) for picture in pictures]
        self.covers, self.tells_cover, self.mist, self.error = covers, covers is not None, mist, error
        self.change_over_error, self.hidden, self.photographs = change, hidden, photographs
        self.read = 0

    def small_drop_cover(self, view: int) -> Plane:
        return self.covers[view]

    def mean_drop_cover(self, view: int) -> Plane:
        """Of the other views of its shape."""
        own = self.covers[view]
        others = [c for i, c in enumerate(self.covers) if i != view and c.shape == own.shape]
        return np.asarray(np.mean(others, axis=0), np.float32)

    def without_mist(self, view: int) -> NDArray[np.float32]:
        return self.photographs[view]

    def lens_mist(self, view: int) -> NetworkMist | None:
        return self.mist

    def training_images(self) -> TrainingImages:
        self.read += 1
        return TrainingImages(self.pictures, self.hidden)

    def small_error(self, view: int) -> Plane | None:
        return self.error
