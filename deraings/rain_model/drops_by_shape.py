"""Drops on the lens of photographs of several shapes: upright ones among others, or another camera's.

The same lens held another way has its drops in other places of the picture. So each shape has a lens of its own.
"""

import logging
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.training.checkpoints import below, prefixed
from deraings.image_planes import Plane
from deraings.lens_views import by_shape
from deraings.rain_model.drops import DropLayer, LensDrops, LensDropsConfig
from hydroviews.scene.images import Image

logger = logging.getLogger(__name__)


class DropsByShape:
    """`LensDrops` of each shape, asked by the number of the view."""

    def __init__(
        self,
        pictures: Sequence[NDArray[np.uint8]],
        iterations: int,
        config: LensDropsConfig,
        hidden: Sequence[NDArray[np.bool_] | None],
    ) -> None:
        """Lenses of which only the fixed pattern is known; logs it where there are several. See `LensDrops`."""
        shapes = by_shape([picture.shape[:2] for picture in pictures])
        if len(shapes) > 1:
            counts = ", ".join(str(len(views)) for views in shapes)
            logger.info("photographs of %d shapes (%s): each has drops of its own", len(shapes), counts)
        self._shapes = shapes
        self.lenses: list[LensDrops] = []
        self._places: dict[int, tuple[LensDrops, int]] = {}  # of views
        for views in shapes:
            lens = LensDrops([pictures[v] for v in views], iterations, config, [hidden[v] for v in views])
            self._places |= {view: (lens, place) for place, view in enumerate(views)}
            self.lenses.append(lens)

    def believe(self, hidden: Callable[[int], Plane]) -> None:
        """See LensDrops; `hidden` tells of each view."""
        for lens, views in zip(self.lenses, self._shapes, strict=True):
            lens.believe([hidden(view) for view in views])

    @property
    def staying(self) -> float:
        """See LensDrops; of the commonest shape."""
        return self.lenses[0].staying

    def due(self, iteration: int) -> bool:
        """See LensDrops."""
        return self.lenses[0].due(iteration)

    def update(self, photograph: Image, seen: Image, view: int, shown: Plane | None = None) -> None:
        """See LensDrops."""
        lens, place = self._places[view]
        lens.update(photograph, seen, place, shown)

    def size(self, view: int) -> tuple[int, int]:
        """Height and width of the lens as a view's drops are kept."""
        return self._places[view][0].size

    def layer(self, view: int, size: tuple[int, int], iteration: int) -> DropLayer | None:
        """See LensDrops."""
        lens, place = self._places[view]
        return lens.layer(place, size, iteration)

    def state_dict(self) -> dict[str, NDArray]:
        """The sums of all lenses, for checkpoints."""
        arrays: dict[str, NDArray] = {}
        for number, lens in enumerate(self.lenses):
            arrays |= prefixed(str(number), lens.state_dict())
        return arrays

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for number, lens in enumerate(self.lenses):
            lens.load_state_dict(below(str(number), arrays))
