"""What masks hide of a capture: nothing at all is hardly meant."""

from typing import NamedTuple

import numpy as np

from hydroviews.formats.photographs import some
from hydroviews.scene.images import image_size
from hydroviews.scene.masks import read_ignored, read_transparent
from hydroviews.scene.point_colours import evenly
from hydroviews.scene.scenes import Scene, View

MASKS, BUDGET = 12, 8e6  # that are read at most, and their pixels in all; one at least


class Hidden(NamedTuple):
    """Sentences on what masks hide."""

    notes: list[str]
    warnings: list[str]


def hidden_by_masks(scene: Scene) -> Hidden:
    """The share that masks hide, of a few of them, evenly spread; a warning where that is nothing.

    Raises:
        InputError: a mask cannot be read.
    """
    masked = [view for view in scene.views if view.mask]
    masks = [view.mask for view in masked if view.mask]
    if not masks:
        return Hidden([], [])
    width, height = image_size(masks[0], "a mask")
    count = int(min(MASKS, max(1, BUDGET // (width * height))))
    shares = [_share(masked[i]) for i in evenly(len(masks), count)]
    looked = "" if len(shares) == len(masks) else f", by {len(shares)} of them"
    clear = sum(view.mask == view.path for view in masked)
    notes, warnings = [f"masks hide {np.mean(shares):.1%} of the pixels{looked}"], []
    if max(shares) == 0:
        warnings.append(
            f"{scene.name}: {len(masks)} masks hide nothing{looked}: black or transparent pixels are hidden, and there "
            "are none; are they meant for something else?"
        )
    if clear:
        notes.append(f"transparent pixels of {clear} photographs are hidden")
    bare = [view.name for view in scene.views if view.mask is None]
    if bare:
        notes.append(f"without a mask, and shown whole: {some(bare)}")
    return Hidden(notes, warnings)


def _share(view: View) -> float:
    """The share that the view's mask hides, at its own size."""
    if view.mask is None:
        return 0.0
    return float((read_transparent if view.mask == view.path else read_ignored)(view.mask).mean())
