"""How much masks hide: those that were drawn the other way round hide all but what they should."""

from collections.abc import Sequence

import numpy as np

from hydroviews.errors import InputError
from hydroviews.scene.scenes import Scene

MOST = 0.5  # share of all pixels from which masks are taken to be the other way round


def hidden_notes(masks: str, shares: Sequence[float], colour: str) -> list[str]:
    """A sentence on masks that hide most pixels; none where they do not.

    Args:
        masks: where they are, for people.
        shares: of hidden pixels in each picture.
        colour: of hidden pixels: white in masks that are drawn for a film, black in those of a capture.

    Raises:
        InputError: they hide every pixel.
    """
    if shares and min(shares) == 1:
        raise InputError(
            f"{masks}: every pixel is hidden",
            expected=f"{colour} where something is to be hidden, not elsewhere",
            fix="invert the masks if they are the other way round",
        )
    share = float(np.mean(shares)) if shares else 0.0
    if share <= MOST:
        return []
    return [f"{masks}: {share:.0%} of the pixels are hidden; {colour} is hidden: are they the other way round?"]


def scene_hidden_notes(scene: Scene) -> list[str]:
    """`hidden_notes` of a scene, at the size of its cameras.

    Raises:
        InputError: its masks hide every pixel, or one is unreadable or of another shape than its photograph.
    """
    masked = [view for view in scene.views if view.mask]
    if not masked:
        return []
    ignored = [view.ignored() for view in masked]
    shares = [0.0 if hidden is None else float(hidden.mean()) for hidden in ignored]
    return hidden_notes(f"{scene.name}: masks", shares + [0.0] * (len(scene.views) - len(masked)), "black")
