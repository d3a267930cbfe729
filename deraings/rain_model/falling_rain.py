"""Falling rain, all of it: the even layer, in front of it each view's single streaks, and when they are learned.

`rain_layer` says whether it rains and how much in the median, S; `streaks` what a view's rain is more or less than
that, D. Both look at a view behind even rain alone: single streaks would hide from them what they are to find.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from baselines.training.images import Size
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane
from deraings.rain_model.observation import Observation
from deraings.rain_model.rain_layer import MIN_ALPHA, RainLayer, RainLayerConfig
from deraings.rain_model.streaks import SingleStreaks, SingleStreaksConfig, along_rain
from hydroviews.scene.images import Image


class FallingRain:
    """The rain layer, and the single streaks of the training views if they are looked for."""

    def __init__(
        self,
        sizes: Sequence[Size],
        iterations: int,
        layer: RainLayerConfig,
        streaks: SingleStreaksConfig | None,
        prior: EnhancedViews | None = None,
    ) -> None:
        """Rain of which nothing is known yet.

        Args:
            sizes: of the training photographs.
            iterations: of the training.
            layer: settings of the even layer.
            streaks: settings of single streaks; None leaves them out.
            prior: the photographs without rain as far as a network sees it, for single streaks; asked only once it
                surely rains.
        """
        self._sizes, self._prior = list(sizes), prior
        self.layer = RainLayer(iterations, layer)
        self.streaks = SingleStreaks(sizes, streaks) if streaks else None
        self._renewals = {round(share * iterations) for share in streaks.renewals} if streaks else set()

    @property
    def even_alpha(self) -> float:
        """S, the median rain_alpha, 0 to 1."""
        return float(self.layer.alpha[0])

    def alpha(self, view: int, size: Size) -> tuple[Plane | None, bool]:
        """rain_alpha [H, W], None where there is none, and whether a view's single streaks are part of it."""
        if streaks := self._known_streaks(view):
            return streaks.alpha(view, self.even_alpha, size), True
        return (np.full(size, self.even_alpha, np.float32) if self.even_alpha else None), False

    def deviation(self, view: int) -> Plane | None:
        """What single streaks add to S or take from it in a view, [h, w] at no more pixels than it has.

        None where none are known. rain_alpha is the sum, at most `max_alpha`.
        """
        streaks = self._known_streaks(view)
        return streaks.deviation(view) if streaks else None

    def _known_streaks(self, view: int) -> SingleStreaks | None:
        """The single streaks, where it rains and those of a view are known."""
        known = self.streaks and self.even_alpha > MIN_ALPHA and view in self.streaks.deviations
        return self.streaks if known else None

    @property
    def max_alpha(self) -> float:
        """The most that rain_alpha may be where there are single streaks."""
        return self.streaks.max_alpha if self.streaks else 1.0

    def due(self, view: int, size: Size, iteration: int) -> bool:
        """Whether to learn in this step from a view rendered at (height, width): small ones hide streaks."""
        return size == self._sizes[view] and (self.layer.due(iteration) or self._streaks_due(view, size))

    def renew(self, iteration: int) -> None:
        """Take single streaks anew from here on, if it is time."""
        if self.streaks and iteration in self._renewals:
            self.streaks.renew()

    def update(self, observed: Observation, even: Image, view: int, iteration: int) -> None:
        """Learn from a view: single streaks if they are due, and the layer if it is.

        Args:
            observed: the photograph.
            even: what the model expects of it behind even rain, [H, W, 3], without drops.
            view: index of the view.
            iteration: of the training.
        """
        if self.streaks and self._streaks_due(view, (even.shape[0], even.shape[1])):
            along, contrast = along_rain(observed.photograph, even, self.even_alpha, self.layer.brightness)
            if observed.weights is not None:
                along, contrast = along * observed.weights, contrast * observed.weights
            self.streaks.update(along, contrast, self.layer.angle(), view, self._prior_deviation(observed, even, view))
        if self.layer.due(iteration):
            self.layer.update(observed.photograph, even, observed.weights, iteration)

    def parts(self) -> list[tuple[str, Any]]:
        """What is learned, by the names of checkpoints."""
        return [("rain_layer", self.layer), *([("streaks", self.streaks)] if self.streaks else [])]

    def _streaks_due(self, view: int, size: Size) -> bool:
        """Whether a view's single streaks are to be taken from it: it surely rains, and they are not known yet."""
        return bool(
            self.streaks
            and self.even_alpha > MIN_ALPHA
            and self.streaks.due(view, size)
            and self.layer.certainty() == 1
        )

    def _prior_deviation(self, observed: Observation, even: Image, view: int) -> Plane | None:
        """D of a view [H, W] as the prior sees it; what it says of S goes to the rain layer.

        0 where the photograph is hidden; None where all of it is, or there is no prior.
        """
        shown = observed.photographed
        if self._prior is None or (shown is not None and not shown.any()):
            return None
        return self.layer.update_prior(observed.photograph, self._prior.image(view), even, shown)
