"""What is known of the lens of every photograph of a capture: statistics of its places, and the mist on it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deraings.enhancement.architecture.lens_statistics import LensStatistics, statistics_of_capture
from deraings.enhancement.architecture.mist_branch import mean_mist, squeezed
from deraings.enhancement.architecture.network import EnhancementNetwork
from hydroviews.scene.masks import Ignored

Read = Callable[[int], NDArray[np.uint8]]


@dataclass(frozen=True, eq=False)
class Lens:
    """Of one run of photographs, as a network wants to know it."""

    fine: Tensor | None  # statistics [FINE, H / 2, W / 2], rounded up; None: drops are new in every photograph
    mist: Tensor | None  # [4, 16, 16], see mist_branch; None: to be looked for in each photograph alone
    mist_error: Tensor | None = None  # standard error of the light that the mist adds [16, 16], over the photographs


def lenses_of_capture(
    count: int, read: Read, network: EnhancementNetwork, hidden: Callable[[int], Ignored | None] = lambda _: None
) -> list[Lens | None]:
    """For every photograph of a capture, in order of name, its lens.

    Args:
        count: how many photographs there are.
        read: the i-th one [H, W, 3], sRGB-encoded, 8 bits.
        network: that is to enhance them.
        hidden: pixels [H, W] of the i-th one that are not to be looked at, None for none.

    Returns:
        None for a photograph without others of its lens, and for all if the network does not look at lenses.
    """
    if not network.config.lens:
        return [None] * count
    statistics = statistics_of_capture(count, read, hidden)
    runs: dict[LensStatistics, list[int]] = {}
    for index, own in enumerate(statistics):
        if own is not None:
            runs.setdefault(own, []).append(index)
    lenses = {own: Lens(own.fine, *_mist(run, read, network, own)) for own, run in runs.items()}
    return [None if own is None else lenses[own] for own in statistics]


def _mist(
    run: Sequence[int], read: Read, network: EnhancementNetwork, statistics: LensStatistics
) -> tuple[Tensor | None, Tensor | None]:
    """The mean of what is found in each photograph, and its error: mist stays on the lens, errors differ."""
    if not (network.config.mist and network.config.lens_mist):
        return None, None
    with torch.inference_mode():
        pictures = torch.cat([_squeezed(read(index)) for index in run]).to(network.device)
        coarse = statistics.coarse[None].to(network.device)
        mists = network.find_mist(pictures, coarse.expand(len(run), -1, -1, -1))
        added = mists[:, 0] * mists[:, 1:].mean(1)
        return mean_mist(mists), added.std(0) / len(run) ** 0.5


def _squeezed(photograph: NDArray[np.uint8]) -> Tensor:
    return squeezed(torch.from_numpy(photograph.astype(np.float32) / 255).permute(2, 0, 1)[None])
