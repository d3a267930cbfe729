"""What neither the scene nor the medium explains of a photograph: a free picture of each view, where it is large.

    R = photograph - (R_scene T + P)    where its mean over the channels is beyond the threshold, else 0

A free picture is always at its best value, so that its pixels pull at nothing: kept is which ones they are. A view's
are chosen anew when it is visited after a while, until then the picture follows its pixels.
"""

import logging

import numpy as np
from numpy.typing import NDArray

from baselines.nimbus.config import ResidualConfig
from baselines.training.checkpoints import below, prefixed
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

logger = logging.getLogger(__name__)
MOST = 0.5  # share of all pixels with residuals above which a warning is logged
Chosen = NDArray[np.bool_]  # [H, W]


def beyond(photograph: Image, seen: Image, threshold: float, ignored: Ignored | None = None) -> Chosen:
    """Which pixels [H, W] are the residual's.

    Args:
        photograph: [H, W, 3].
        seen: what scene and medium make of it, [H, W, 3].
        threshold: of the mean difference over the channels; only what is brighter than expected counts.
        ignored: pixels [H, W] that are hidden, and are not the residual's.
    """
    chosen: Chosen = (photograph - seen).mean(axis=2) > threshold
    return chosen if ignored is None else chosen & ~ignored


class Residuals:
    """Which pixels of each view are its residual's."""

    def __init__(self, config: ResidualConfig | None, n_views: int, iterations: int) -> None:
        """None yet, for a training of so many iterations; without settings there never are any."""
        self.config, self._iterations = config, iterations
        self.chosen: dict[int, Chosen] = {}
        self._made = np.full(n_views, -1)  # at which iteration
        self._shares = np.zeros(n_views)  # of the pixels
        self._warned = False

    def of(self, photograph: Image, seen: Image, view: int, iteration: int, ignored: Ignored | None) -> Chosen | None:
        """The pixels of a view that is visited, chosen anew if that is due; None while all are the scene's."""
        config = self.config
        if config is None or iteration < round(config.first * self._iterations):
            return None
        size, known = photograph.shape[:2], self.chosen.get(view)
        if (
            known is None
            or known.shape != size
            or iteration - self._made[view] >= round(config.every * self._iterations)
        ):
            known = beyond(photograph, seen, config.threshold, ignored)
            self.chosen[view], self._made[view] = known, iteration
            self._shares[view] = known.mean()
            self._watch(iteration, config.threshold)
        return known

    @property
    def share(self) -> float:
        """Of the pixels of all views that have one, those that are the residual's."""
        made = self._made >= 0
        return float(self._shares[made].mean()) if made.any() else 0.0

    def state_dict(self) -> dict[str, NDArray]:
        """For checkpoints."""
        views = prefixed("view", {str(view): chosen.astype(np.uint8) for view, chosen in self.chosen.items()})
        return {**views, "made": self._made, "shares": self._shares, "warned": np.array([self._warned], np.uint8)}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        self.chosen = {int(view): chosen.astype(bool) for view, chosen in below("view", arrays).items()}
        self._made, self._shares = arrays["made"].copy(), arrays["shares"].copy()
        self._warned = bool(arrays["warned"][0])

    def _watch(self, iteration: int, threshold: float) -> None:
        """Say, once, that residuals take most of the photographs; when every view has one."""
        if not self._warned and (self._made >= 0).all() and self.share > MOST:
            self._warned = True
            logger.warning(
                "training: residuals hold %.0f %% of the photographs' pixels after %d iterations, threshold %g: "
                "the scene is learned from the rest",
                100 * self.share,
                iteration + 1,
                threshold,
            )
