"""Which photographs one lens took, held one way: what is on it lies in the same place of these alone."""

import logging
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

logger = logging.getLogger(__name__)

ALIKE = 0.1  # difference of the logarithms of two ratios of sides: 4:3 and 3:2 differ by 0.12, lenses set right by less


def one_shape(first: tuple[int, ...], second: tuple[int, ...]) -> bool:
    """Whether pictures of two sizes (height, width) have one shape, as far as one lens goes."""
    return abs(math.log(first[1] * second[0] / (first[0] * second[1]))) < ALIKE


def views_of_one_lens(sizes: Sequence[tuple[int, ...]]) -> list[bool]:
    """Which pictures, of (height, width) each, have the shape of most; of two as common ones, of the first."""
    kinds = {size: [one_shape(size, other) for other in sizes] for size in dict.fromkeys(sizes)}
    return max(kinds.values(), key=sum, default=[])


def warn_of_other_lenses(one_lens: Sequence[bool]) -> None:
    """Log how many pictures are not of the one lens, if any."""
    others = len(one_lens) - sum(one_lens)
    if others:
        logger.warning(
            "photographs: %d of %d have another shape, so another lens took them, or it was held another way: mist and "
            "drops that stay on the lens are looked for in the rest alone. Train those of one shape by themselves",
            others,
            len(one_lens),
        )


def hide_other_lenses(
    pictures: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_] | None], one_lens: Sequence[bool]
) -> tuple[list[NDArray[np.uint8]], list[NDArray[np.bool_] | None]]:
    """Pictures [H, W, 3] and masks [H, W] of what is hidden, with those of other lenses replaced by hidden black ones.

    Raises:
        ValueError: no picture is of the one lens.
    """
    like = pictures[list(one_lens).index(True)]
    black, everything = np.zeros_like(like), np.ones(like.shape[:2], np.bool_)
    kept = [picture if own else black for picture, own in zip(pictures, one_lens, strict=True)]
    return kept, [mask if own else everything for mask, own in zip(hidden, one_lens, strict=True)]
