"""Falling rain: new in every view, so that views disagree on it, but it only ever adds light.

    R = (1 - S - D) B + (S + D) beta,   in encoded values

What many views agree on is the median, and in denser rain there is some of it in front of the median pixel: the scene
is learned as if behind an even layer, S, the median rain_alpha. Such a layer cannot be told from a brighter scene of
less contrast by any single pixel. Statistics of the rain_alpha that makes the photograph of the render tell it
(`streak_statistics`): one says that it rains, another how much. Where a network predicts the rain of single
photographs, S is the mean of both in logarithms. Where it does not rain S is 0, whatever the scene.

D is what a view's rain is more or less than S (`streaks`). Both are estimated behind even rain alone: single streaks
would hide from them what they are to find.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.training.images import Size
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized, within_side
from deraings.rain_model.config import RainfallConfig
from deraings.rain_model.kernels import behind_rain, shade
from deraings.rain_model.streak_statistics import (
    ANGLES,
    LEAST,
    along_line,
    alpha_of_shot_noise,
    directed_skew,
    line_powers,
    streak_angle,
)
from deraings.rain_model.streaks import LONG_SIDE, SingleStreaks, along_rain, alpha_along
from hydroviews.scene.images import Image

THIRDS = np.full(3, 1 / 3, np.float32)
LEARNED = ("powers", "shot_alpha", "predicted", "predicted_along", "alpha")
TELLING = 0.2  # encoded; in front of what is nearer to beta than that, rain does not show
HALF = 0.5
MIN_CLEAR = 0.05  # share of a view's pixels that show rain; the skewness of fewer is chance
MIN_ALPHA = 0.004  # rain_alpha that is as good as none
MIN_UPDATES = 14.0  # sum of remembered weights, some 16 updates: after fewer, dry scenes were taken for rainy
MOST = 0.95  # rain_alpha
RENEWALS = 0.45, 0.65  # of the training, at which D is taken anew, as the scene has forgotten what D explains


class Observation(NamedTuple):
    """A training photograph, and which of its pixels count."""

    photograph: Image  # [H, W, 3]
    photographed: Plane | None  # [H, W], 0 where the photograph's mask hides it; None where nothing is hidden
    shown: Plane | None  # [H, W], the same, and 0 where the render is not finite
    weights: Plane | None  # [H, W] factors on each pixel's share of the loss; None where all are 1


class Rainfall:
    """Running statistics of photographs and renders, the median rain_alpha S that follows, and each view's streaks."""

    def __init__(
        self,
        sizes: Sequence[Size],
        iterations: int,
        first: int,
        config: RainfallConfig,
        network: EnhancedViews | None = None,
    ) -> None:
        """Rain of which nothing is known yet.

        Args:
            sizes: of the training photographs.
            iterations: of the training.
            first: iteration in which rain is looked for first.
            config: settings.
            network: the photographs without rain as a network predicts them, asked only once it surely rains.
        """
        self._sizes, self._config, self._network, self._first = list(sizes), config, network, first
        self._every = max(1, (iterations - first) // config.updates)
        self._renewals = {round(share * iterations) for share in RENEWALS}
        self._settled = iterations / 2  # later, renders have learned some of the streaks: cumulants are too small
        self.streaks = SingleStreaks(sizes, config.visits)
        self.powers = np.zeros((len(ANGLES), 3))  # sums of weights, squares and cubes of differences along lines
        self.shot_alpha = np.zeros(1)  # S as the streaks' cumulants have it
        self.predicted = np.zeros(2)  # sum and number of the network's median alphas
        self.predicted_along = np.zeros(2)  # sums of (network x scene) and network^2, both along the streaks
        self.alpha = np.zeros(1)  # S

    @property
    def brightness(self) -> float:
        """beta, the encoded value of what streaks are made of."""
        return self._config.brightness

    @property
    def even_alpha(self) -> float:
        """S, the median rain_alpha, 0 to 1."""
        return float(self.alpha[0])

    def rain_alpha(self, view: int, size: Size) -> Plane | None:
        """S + D [H, W] of a view at (height, width); None where there is no rain."""
        deviation = self.deviation(view)
        if deviation is not None:
            return np.clip(np.float32(self.even_alpha) + resized(deviation, size), 0, np.float32(MOST))
        return np.full(size, self.even_alpha, np.float32) if self.even_alpha else None

    def deviation(self, view: int) -> Plane | None:
        """D of a view, [h, w] at no more pixels than it has; None where none is known."""
        return self.streaks.deviation(view) if self.even_alpha > MIN_ALPHA else None

    def forward(self, image: Image, alpha: Plane, out: Image) -> Image:
        """The view [H, W, 3] behind rain of alpha [H, W], written to `out`."""
        behind_rain(image, alpha, np.float32(self.brightness), out)
        return out

    def backward(self, gradient: Image, alpha: Plane, out: Image) -> Image:
        """The gradient by the view [H, W, 3], written to `out`, from that by what `forward` returned."""
        shade(gradient, alpha, out)
        return out

    def due(self, view: int, size: Size, iteration: int) -> bool:
        """Whether to learn in this step from a view rendered at (height, width): small ones hide streaks."""
        return size == self._sizes[view] and (self._layer_due(iteration) or self._streaks_due(view))

    def begin(self, iteration: int) -> None:
        """Take single streaks anew from here on, if it is time."""
        if iteration in self._renewals:
            self.streaks.renew()

    def update(self, observed: Observation, even: Image, view: int, iteration: int) -> None:
        """Learn from a view: single streaks if they are due, and S if it is.

        Args:
            observed: the photograph.
            even: what the model expects of it behind even rain, [H, W, 3], without drops.
            view: index of the view.
            iteration: of the training.
        """
        if self._streaks_due(view):
            along, contrast = along_rain(observed.photograph, even, self.even_alpha, self.brightness)
            if observed.weights is not None:
                along, contrast = along * observed.weights, contrast * observed.weights
            self.streaks.update(along, contrast, self.angle(), view, self._predicted_deviation(observed, even, view))
        if self._layer_due(iteration):
            self._update_layer(observed.photograph, even, observed.weights, iteration)

    def certainty(self) -> float:
        """How sure it is that it rains, 0 to 1; 0 after few updates."""
        config = self._config
        if self.powers[0, 0] < MIN_UPDATES:
            return 0.0
        return float(np.clip((directed_skew(self.powers) - config.dry) / (config.rainy - config.dry), 0, 1))

    def angle(self) -> int:
        """The direction of the streaks in degrees counter-clockwise from +x, to 15 degrees."""
        return streak_angle(self.powers)

    def state_dict(self) -> dict[str, NDArray]:
        """All statistics, for checkpoints."""
        return {name: getattr(self, name) for name in LEARNED}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for name in LEARNED:
            setattr(self, name, arrays[name].copy())

    def parts(self) -> list[tuple[str, Any]]:
        """What is learned, by the names of checkpoints."""
        return [("rainfall", self), ("streaks", self.streaks)]

    def _layer_due(self, iteration: int) -> bool:
        return iteration >= self._first and iteration % self._every == 0

    def _streaks_due(self, view: int) -> bool:
        """Whether a view's single streaks are to be taken from it: it surely rains, and they are not known yet."""
        return self.even_alpha > MIN_ALPHA and self.streaks.due(view) and self.certainty() == 1

    def _update_layer(self, photograph: Image, seen: Image, weights: Plane | None, iteration: int) -> None:
        """Add a view to the statistics, and renew S; a view that is too light nearly everywhere shows nothing."""
        config = self._config
        alpha = np.clip(alpha_between(photograph, seen, self.brightness), -1, 1)
        clear = self._shows_rain(seen, weights)
        if clear.mean() < MIN_CLEAR:
            return
        powers = line_powers(_small(alpha), config.line_length, _small_mask(clear))
        self.powers = (1 - 1 / config.memory) * self.powers + powers
        if iteration < self._settled or self.certainty() < 1:
            self.shot_alpha[0] = alpha_of_shot_noise(self.powers)
        self.alpha[0] = min(self.certainty() * self._alpha_if_it_rains(), HALF)

    def _predicted_deviation(self, observed: Observation, even: Image, view: int) -> Plane | None:
        """D of a view [H, W] as the network predicts it, 0 where the photograph is hidden; the rest's median is 0.

        The network's own S is added to the statistics. None where all of the photograph is hidden, or without one.
        """
        shown = observed.photographed
        if self._network is None or (shown is not None and not shown.any()):
            return None
        dry = self._network.training_images().pixels(view) / np.float32(255)
        found, by_scene = (alpha_between(observed.photograph, other, self.brightness) for other in (dry, even))
        median = np.median(found if shown is None else found[shown > 0])
        self.predicted += float(median), 1
        clear = _small_mask(self._shows_rain(even, shown))
        if clear.mean() >= MIN_CLEAR:
            by_scene = (1 - self.even_alpha) * np.clip(by_scene, -1, 1)
            length, angle = self._config.line_length, self.angle()
            predicted, scene = (along_line(_small(plane), clear, length, angle) for plane in (found, by_scene))
            self.predicted_along += np.mean(predicted * scene), np.mean(predicted**2)
        return found - median if shown is None else (found - median) * shown

    def _prediction_gain(self) -> float:
        """How many times the streaks that the network finds the scene has: the slope of one in the other.

        A network that sees a single picture draws streaks paler and wider than they are. The other views tell by how
        much: what else a render lacks is independent of it.
        """
        products, squares = self.predicted_along
        return max(0.0, float(products / squares)) if squares > LEAST else 1.0

    def _alpha_if_it_rains(self) -> float:
        """S if it surely rained: the mean, in logarithms, of the cumulants' and the network's.

        The network's median is too little of dense rain, and times `_prediction_gain` too much of sparse rain.
        """
        shot = float(self.shot_alpha[0])
        if not self.predicted[1]:
            return shot
        found = max(0.0, self.predicted[0] / self.predicted[1]) * np.sqrt(self._prediction_gain())
        return max(0.5 * shot, float(np.sqrt(shot * found)))

    def _shows_rain(self, seen: Image, weights: Plane | None) -> NDArray[np.bool_]:
        """Where a view [H, W, 3] is dark enough, and weighs enough, to show rain in front of it [H, W]."""
        clear = self.brightness - seen @ THIRDS > TELLING
        return clear if weights is None else clear & (weights > HALF)


def alpha_between(photograph: Image, dry: Image, brightness: float) -> Plane:
    """The rain_alpha [H, W] that turns a dry picture [H, W, 3] into its photograph; near 0 where they do not tell.

    Least squares over the channels of O - B = rain_alpha (beta - B), which tells little where B is near to beta.
    """
    along, length = along_rain(photograph, dry, 0.0, brightness)
    return alpha_along(along, length)


def _small(plane: Plane) -> Plane:
    """A plane [H, W], averaged down to a longer side of LONG_SIDE."""
    return resized(plane, within_side(plane.shape, LONG_SIDE))


def _small_mask(clear: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The same of a mask: where more than half of a pixel is clear."""
    return _small(clear.astype(np.float32)) > HALF
