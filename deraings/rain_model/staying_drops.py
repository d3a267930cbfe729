"""Drops that stay on the lens as a network sees them: a second witness, before and beside the lines of `drops`.

A line needs views in which the scene behind a drop differs, and a scene that is not learned from the drop itself. At
first there is neither; and of few views a scene soon learns the drops of each, after which photographs follow the
render everywhere. A network sees drops in single photographs; what stays is in the same place of the views taken
before and after (`enhancement.clear_pixels`). So from the first step pixels count less where the network sees such
drops, and lines are believed there even if little detail stays.

It takes some of the scene for drops, and all of a pixel that a drop half covers. Where many views tell better, its
word counts no more once lines have been learned.

Drops that are new in every view are no business of this part: `renewed_drops`.
"""

from dataclasses import dataclass

from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized


@dataclass(frozen=True)
class StayingDropsConfig:
    """When a network is asked for drops that stay, and how long its word counts.

    Numbers were chosen on courtyard, LLFF flower and Mip-NeRF 360 bonsai (docs/experiments/2026-11-rain-model.md).

    Attributes:
        min_staying: share of the lens, [0, 1], that shows detail which stays, from which it is asked: clean views and
            streaks have 0.07 at most, half of the drops renewed 0.17, light ones on eight photographs 0.22 and more.
        until: share of the iterations, [0, 1], up to which pixels count less.
        many_views: so many photographs tell better than the network; of fewer, pixels count less to the end.
    """

    min_staying: float = 0.2
    until: float = 0.5
    many_views: int = 24


class StayingDrops:
    """What drops hide of the lens, by the number of the view."""

    def __init__(
        self, enhanced: EnhancedViews, n_views: int, staying: float, iterations: int, config: StayingDropsConfig
    ) -> None:
        """Ask the network, if detail stays on the lens; it then looks at all photographs, showing progress.

        Args:
            enhanced: the photographs as a network sees them that tells what drops cover.
            n_views: how many there are.
            staying: share of the lens that shows detail which stays.
            iterations: of the training.
            config: settings.
        """
        self._enhanced = enhanced
        self._last = iterations if n_views < config.many_views else config.until * iterations
        self.asked = staying >= config.min_staying  # whether detail stays, be it that of drops or not
        self.wanted = self.asked and enhanced.drops_stay

    def hidden(self, view: int) -> Plane:
        """What the network's drops hide of the lens about the time of a view [h, w], [0, 1]."""
        return self._enhanced.hidden_by_drops(view)

    def due(self, iteration: int) -> bool:
        """Whether pixels count less in this iteration."""
        return self.wanted and iteration < self._last

    def cover(self, view: int, size: tuple[int, int]) -> Plane:
        """The same of each pixel of a view [H, W]; 1 less it are factors on pixels' shares of the loss, when due."""
        return resized(self.hidden(view), size)
