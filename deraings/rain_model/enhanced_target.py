"""Photographs as a network enhanced them, as a second target of the scene: behind mist, and at first in streaks.

Mist that is taken for a little too thick leaves a scene that is a little too dark, and the photographs fit all the
same. An enhanced photograph has other errors. So in every second of the earlier steps the scene as it is, not as it is
seen through the rain, is compared with that, and each target keeps the scene from learning the other's errors. The last
steps compare with the photographs alone: details are there.

A network that does not know this rain leaves it in, and every second step would learn it. It is believed only where it
has taken away a good part of the mist that photographs allow (`mist_bounds`), some of which is the scene's own light.

Falling rain is found in what photographs have and the scene has not. Until it is, a scene learns the streaks, and has
to forget them. Where a network sees streaks, the first steps compare the scene with enhanced photographs instead.
"""

from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from baselines.splatting.kernels.photometric import Target, prepare_target
from baselines.training.images import Size, TrainingImages, evenly_spread
from deraings.enhancement.views import EnhancedViews
from deraings.rain_model.mist_bounds import mist_bounds
from deraings.rain_model.mist_config import MistConfig
from hydroviews.scene.images import to_uint8


@dataclass(frozen=True)
class EnhancedTargetConfig:
    """When the scene is learned from enhanced photographs as well.

    Numbers were chosen on courtyard, LLFF flower and Mip-NeRF 360 bonsai (docs/experiments/2026-11-rain-model.md).

    Attributes:
        min_removed: share of the mist that photographs allow, [0, 1], that the network must have taken away to be
            believed: it takes 0.86 and more of heavy mist, 0.48 to 0.76 of medium mist, 0.33 to 0.48 of light mist, and
            0.28 of haze, where it errs.
        sample: photographs, at least 1, by which that is judged.
        until: share of the iterations, [0, 1], up to which the scene is learned from them.
        min_streaks: mean cover by streaks, [0, 1], that the network must see for a start from them: light ones of
            development scenes have 0.04, drops 0.005.
        streaks_sample: photographs, at least 1, by which that is judged.
        streaks_until: share of the iterations, [0, 1], of that start; from 0.2 to 0.45 it makes no difference.
    """

    min_removed: float = 0.3
    sample: int = 40
    until: float = 0.6
    min_streaks: float = 0.02
    streaks_sample: int = 8
    streaks_until: float = 0.3


class _EnhancedPictures:
    """Enhanced photographs as targets of the earlier steps."""

    def __init__(self, images: TrainingImages | None, last: float) -> None:
        """Pictures, None where they are not believed, and the iteration before which steps are compared with them."""
        self._images, self._last = images, last

    def due(self, iteration: int) -> bool:
        """Whether the scene is compared with an enhanced photograph in this step."""
        return self._images is not None and iteration < self._last

    def target(self, view: int, size: Size) -> Target:
        """An enhanced photograph at (height, width), to compare the scene with in a step that is due."""
        assert self._images is not None  # no step is due otherwise
        return prepare_target(self._images.pixels(view, size), self._images.ignored(view, size))


class EnhancedTarget(_EnhancedPictures):
    """The enhanced photographs, where the network is believed, and when they are compared with the scene."""

    def __init__(
        self,
        images: TrainingImages,
        enhanced: EnhancedViews,
        iterations: int,
        mist: MistConfig,
        config: EnhancedTargetConfig,
    ) -> None:
        """Judge the network by a sample; where it is believed, enhance all photographs, showing progress.

        Args:
            images: the training photographs, behind mist.
            enhanced: the same as the network sees them.
            iterations: of the training.
            mist: how it is found what photographs allow of mist.
            config: settings.

        Raises:
            InputError: a kept picture is damaged.
        """
        self.removed = removed_mist(images, enhanced, mist, config.sample)
        believed = self.removed >= config.min_removed
        super().__init__(enhanced.training_images() if believed else None, config.until * iterations)

    def due(self, iteration: int) -> bool:
        """See above; every second one is."""
        return iteration % 2 == 1 and super().due(iteration)


class EnhancedStart(_EnhancedPictures):
    """The enhanced photographs, where a network sees streaks, and when they are compared with the scene."""

    def __init__(
        self, images: TrainingImages, enhanced: EnhancedViews, iterations: int, config: EnhancedTargetConfig
    ) -> None:
        """Look for streaks in a sample; where there are some, enhance all photographs, showing progress.

        Args:
            images: the training photographs.
            enhanced: the same as a network sees them that tells what rain covers.
            iterations: of the training.
            config: settings.

        Raises:
            InputError: a kept picture is damaged.
        """
        views = evenly_spread(len(images), config.streaks_sample)
        seen = np.mean([enhanced.streak_cover(view).mean() for view in views]) >= config.min_streaks
        super().__init__(enhanced.training_images() if seen else None, config.streaks_until * iterations)


def removed_mist(images: TrainingImages, enhanced: EnhancedViews, mist: MistConfig, sample: int) -> float:
    """The share of the mist, the median over the lens, that photographs allow and enhanced ones do not; at most 1.

    Args:
        images: the photographs; up to `sample` of all times are looked at.
        enhanced: the same without rain as far as a network sees it.
        mist: how it is found what photographs allow of mist.
        sample: at least 1.

    Raises:
        InputError: a kept picture is damaged.
    """
    views = evenly_spread(len(images), sample)
    hidden = [images.ignored(view) for view in views]
    left = [to_uint8(enhanced.image(view)) for view in tqdm(views, desc="mist removed", unit="view", leave=False)]
    kinds = [images.pixels(view) for view in views], left
    before, after = (mist_bounds(pictures, mist, hidden).usual for pictures in kinds)
    return 1 - after / before if before > 0 else 0.0
