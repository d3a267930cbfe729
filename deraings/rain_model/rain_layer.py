"""Falling rain: new in every view, so that views disagree on it, but it only ever adds light.

What many views agree on is the median, and in denser rain there is some of it in front of the median pixel: the scene
is learned as if behind an even layer, R = (1 - S) B + S beta in encoded values with S the median rain_alpha. Such a
layer cannot be told from a brighter scene of less contrast by any single pixel. Statistics of the rain_alpha that makes
the photograph of the render tell it (`streak_statistics`): one says that it rains, another how much. Where a prior sees
the rain of single photographs, S is a mean of both opinions. Where it does not rain S is 0, whatever the scene.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, resized, within_side
from deraings.rain_model.layer_kernels import behind_rain, shade
from deraings.rain_model.rain_kernels import cover
from deraings.rain_model.streak_statistics import (
    ANGLES,
    LEAST,
    along_line,
    alpha_of_shot_noise,
    directed_skew,
    line_powers,
    streak_angle,
)
from hydroviews.scene.images import Image

THIRDS = np.full(3, 1 / 3, np.float32)
LONG_SIDE = 480  # pixels; streaks are looked for in no larger pictures
LEARNED = ("powers", "shot_alpha", "prior", "prior_along", "alpha")
MIN_CONTRAST = 0.1  # encoded; in front of what is nearer to beta than that, streaks are hardly seen
TELLING = 0.2  # the same; what is nearer is not counted
HALF = 0.5
MIN_CLEAR = 0.05  # share of a view's pixels that tell; the skewness of fewer is chance
MIN_ALPHA = 0.004  # rain_alpha that is as good as none


@dataclass(frozen=True)
class RainLayerConfig:
    """How falling rain is found and accounted for.

    Numbers without a source were chosen on courtyard and LLFF flower (docs/experiments/2026-11-rain-model.md).

    Attributes:
        brightness: beta, the encoded value of streaks, (0, 1]. It cannot be told from the photographs; an error of 0.1
            changes the scene by 0.1 S.
        line_length: length of the lines along which differences are averaged, in longer sides of the picture, (0, 1).
        start: share of the iterations, [0, 1), before the first update; earlier, detail that is not learned yet would
            be taken for streaks. 0.1 is best of 0.05 to 0.2.
        settled: share of the iterations after which the streaks' cumulants are not looked at any more if it surely
            rains: renders have learned some of the streaks by then.
        updates: in all, spread evenly over the training.
        memory: updates that running sums remember, more than `min_updates`.
        min_updates: sum of remembered weights before anything is believed, some 16 updates: after fewer, dry scenes
            were taken for rainy for a moment.
        dry: excess skew of one direction up to which it does not rain.
        rainy: excess skew, above `dry`, from which it surely does.
        max_alpha: most that S may be, [0, 1).
    """

    brightness: float = 0.88
    line_length: float = 1 / 45
    start: float = 0.1
    settled: float = 0.5
    updates: int = 240
    memory: int = 60
    min_updates: float = 14.0
    dry: float = 0.06
    rainy: float = 0.12
    max_alpha: float = 0.5

    def __post_init__(self) -> None:
        if not self.min_updates < self.memory:
            raise ValueError(
                f"min_updates {self.min_updates} of {self.memory} remembered ones: rain could never be believed"
            )
        if not self.dry < self.rainy:
            raise ValueError(f"rainy {self.rainy} is no more than dry {self.dry}")


class RainLayer:
    """Running statistics of photographs and renders, and the median rain_alpha S that follows."""

    def __init__(self, iterations: int, config: RainLayerConfig) -> None:
        self._config = config
        self._first, self._settled = round(config.start * iterations), round(config.settled * iterations)
        self._every = max(1, (iterations - self._first) // config.updates)
        self.powers = np.zeros((len(ANGLES), 3))  # sums of weights, squares and cubes of differences along lines
        self.shot_alpha = np.zeros(1)  # S as the streaks' cumulants have it
        self.prior = np.zeros(2)  # sum and number of the prior's median alphas
        self.prior_along = np.zeros(2)  # sums of (prior x scene) and prior^2, both along the streaks
        self.alpha = np.zeros(1)  # S

    @property
    def brightness(self) -> float:
        """beta, the encoded value of what streaks are made of."""
        return self._config.brightness

    def forward(self, image: Image, alpha: Plane, out: Image) -> Image:
        """The view [H, W, 3] behind rain of alpha [H, W], written to `out`."""
        behind_rain(image, alpha, np.float32(self.brightness), out)
        return out

    def backward(self, gradient: Image, alpha: Plane, out: Image) -> Image:
        """The gradient by the view [H, W, 3], written to `out`, from that by what `forward` returned."""
        shade(gradient, alpha, out)
        return out

    def due(self, iteration: int) -> bool:
        """Whether to look at a view in this step."""
        return iteration >= self._first and iteration % self._every == 0

    def update(self, photograph: Image, seen: Image, weights: NDArray[np.float32] | None, iteration: int) -> None:
        """Add a view to the statistics, and renew S; a view that is too light nearly everywhere tells nothing.

        Args:
            photograph: [H, W, 3].
            seen: what the model expects of it, [H, W, 3], behind even rain.
            weights: of the pixels [H, W]; those of weight 0 are not looked at.
            iteration: of the training.
        """
        config = self._config
        alpha = np.clip(alpha_between(photograph, seen, self.brightness), -1, 1)
        clear = self._tells(seen, weights)
        if clear.mean() < MIN_CLEAR:
            return
        powers = line_powers(_small(alpha), config.line_length, _small_mask(clear))
        self.powers = (1 - 1 / config.memory) * self.powers + powers
        if iteration < self._settled or self.certainty() < 1:
            self.shot_alpha[0] = alpha_of_shot_noise(self.powers)
        self.alpha[0] = min(self.certainty() * self.alpha_if_it_rains(), config.max_alpha)

    def update_prior(self, photograph: Image, without_rain: Image, seen: Image, shown: Plane | None) -> Plane:
        """Add what a prior finds in a view, and how that compares with what the scene says.

        Args:
            photograph: [H, W, 3].
            without_rain: the same as the prior has it, [H, W, 3].
            seen: what the model expects of it, [H, W, 3], behind even rain.
            shown: [H, W], 0 where the photograph is hidden, 1 elsewhere, not 0 everywhere; None where all is shown.

        Returns:
            D as the prior finds it [H, W], 0 where the photograph is hidden; the median of the rest is 0.
        """
        found, by_scene = (alpha_between(photograph, dry, self.brightness) for dry in (without_rain, seen))
        median = np.median(found if shown is None else found[shown > 0])
        self.prior += float(median), 1
        clear = _small_mask(self._tells(seen, shown))
        if clear.mean() >= MIN_CLEAR:
            by_scene = (1 - self.alpha[0]) * np.clip(by_scene, -1, 1)
            length, angle = self._config.line_length, self.angle()
            prior, scene = (along_line(_small(plane), clear, length, angle) for plane in (found, by_scene))
            self.prior_along += np.mean(prior * scene), np.mean(prior**2)
        return found - median if shown is None else (found - median) * shown

    def prior_gain(self) -> float:
        """How many times the streaks that the prior finds the scene has: the slope of one in the other; 1 if unknown.

        A network that sees a single picture draws streaks paler and wider than they are. By how much, the other views
        tell: what else a render lacks is independent of it.
        """
        products, squares = self.prior_along
        return max(0.0, float(products / squares)) if squares > LEAST else 1.0

    def alpha_if_it_rains(self) -> float:
        """S if it surely rained: what the streaks' cumulants say, or a mean of that and what the prior finds.

        The prior's median is too little of dense rain, and times `prior_gain` too much of sparse rain. Opinions differ
        by factors, and too large an S costs more than too small a one: the means are geometric. A prior that sees next
        to no rain takes away half of S at most.
        """
        shot = float(self.shot_alpha[0])
        if not self.prior[1]:
            return shot
        found = max(0.0, self.prior[0] / self.prior[1]) * np.sqrt(self.prior_gain())
        return max(0.5 * shot, float(np.sqrt(shot * found)))

    def certainty(self) -> float:
        """How sure it is that it rains, 0 to 1; 0 after few updates."""
        config = self._config
        if self.powers[0, 0] < config.min_updates:
            return 0.0
        return float(np.clip((directed_skew(self.powers) - config.dry) / (config.rainy - config.dry), 0, 1))

    def angle(self) -> int:
        """The direction of the streaks in degrees counter-clockwise from +x, to 15 degrees."""
        return streak_angle(self.powers)

    def _tells(self, seen: Image, weights: Plane | None) -> NDArray[np.bool_]:
        """Where a view [H, W, 3] is dark enough, and weighs enough, to show rain in front of it [H, W]."""
        clear = self.brightness - seen @ THIRDS > TELLING
        return clear if weights is None else clear & (weights > HALF)

    def state_dict(self) -> dict[str, NDArray]:
        """All statistics, for checkpoints."""
        return {name: getattr(self, name) for name in LEARNED}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for name in LEARNED:
            setattr(self, name, arrays[name].copy())


def alpha_between(photograph: Image, dry: Image, brightness: float) -> Plane:
    """The rain_alpha [H, W] that turns a dry picture [H, W, 3] into its photograph; near 0 where they do not tell.

    Least squares over the channels of O - B = rain_alpha (beta - B), which tells little where B is near to beta.
    """
    alpha = np.empty(photograph.shape[:2], np.float32)
    cover(photograph, dry, np.float32(brightness), np.float32(MIN_CONTRAST**2), alpha)
    return alpha


def _small(plane: Plane) -> Plane:
    """A plane [H, W], averaged down to a longer side of LONG_SIDE."""
    return resized(plane, within_side(plane.shape, LONG_SIDE))


def _small_mask(clear: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The same of a mask: where more than half of a pixel is clear."""
    return _small(clear.astype(np.float32)) > HALF
