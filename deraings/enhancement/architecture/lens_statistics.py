"""What the photographs of one lens say of every place of the lens.

A single picture does not tell thin mist from a bright scene, nor a drop from a blurred thing. Of many photographs each
shows something else behind the same mist and drops: mist lifts the darkest that is ever seen at a place, and a drop
dulls whatever is behind it. So per place of the lens: means, spreads and low quantiles of light and of fine detail.
They are of the photographs alone; nothing here knows how rain is drawn.

Statistics are tensors of pictures at half the resolution, in which the enhancement network looks at them too:

* coarse [COARSE, 16, 16], for the branch that takes off mist;
* fine [FINE, H / 2, W / 2], for the rest.

The last channel of each tells how many photographs they are of; where it is 0 there are none.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from deraings.enhancement.architecture.mist_branch import CELLS, cell_statistics, decoded, squeezed
from hydroviews.scene.masks import Ignored

COARSE, FINE = 43, 10  # channels
LOW = 0.25  # quantile
LONGEST_RUN = 48  # photographs, in order of name, that are looked at together; longer captures are in several runs
BAND = 256  # rows that are looked at at once, for memory's sake
BLUR = 3  # pixels at half the resolution; what differs from means of such squares is fine detail
LEAST_SPREAD = 1e-3  # of linear light, below which spreads are all alike
LUMA = (0.299, 0.587, 0.114)


@dataclass(frozen=True, eq=False)
class LensStatistics:
    """Of one run of photographs."""

    coarse: Tensor  # [COARSE, 16, 16]
    fine: Tensor  # [FINE, H / 2, W / 2], rounded up


def lens_statistics(halves: Tensor) -> LensStatistics:
    """Of pictures [K, 3, H / 2, W / 2], at least one; see `halved`."""
    return LensStatistics(coarse_statistics(halves), fine_statistics(halves))


def halved(image: Tensor) -> Tensor:
    """Pictures [N, 3, H, W] at half the resolution, rounded up."""
    return functional.avg_pool2d(image, 2, ceil_mode=True, count_include_pad=False)


def coarse_statistics(pictures: Tensor) -> Tensor:
    """Of the cells of pictures [K, 3, H, W], over all of them: [COARSE, 16, 16]; zeros for a single one."""
    return over_pictures(cell_statistics(squeezed(pictures)))


def over_pictures(cells: Tensor) -> Tensor:
    """The same, of what `cell_statistics` found in each, [K, 18, 16, 16]."""
    if len(cells) < 2:
        return torch.zeros(COARSE, CELLS, CELLS)
    mean, highest, lowest, low = cells[:, :3], cells[:, 6:9], cells[:, 9:12], cells[:, 12:15]
    over = [cells.mean(0), lowest.amin(0), low.amin(0), low_quantile(low), 3 * mean.std(0), highest.amax(0)]
    # In linear light mist adds to the darkest, and the spread of what is behind it shrinks by a factor.
    linear = [
        10 * decoded(lowest.amin(0)),
        10 * decoded(low.amin(0)),
        0.3 * (decoded(mean).std(0) + LEAST_SPREAD).log(),
    ]
    return torch.cat([*over, *linear, how_many(len(cells), over[0])])


def fine_statistics(pictures: Tensor) -> Tensor:
    """Of the places of pictures [K, 3, H, W]: [FINE, H, W]; zeros for a single one."""
    count, _, height, width = pictures.shape
    if count < 2:
        return torch.zeros(FINE, height, width)
    light = torch.einsum("kchw,c->khw", pictures, pictures.new_tensor(LUMA))
    around = functional.avg_pool2d(light, BLUR, stride=1, padding=BLUR // 2, count_include_pad=False)
    detail = (light - around).abs()
    over = [light.amin(0), low_quantile(light), 3 * light.std(0), 10 * detail.mean(0), 30 * low_quantile(detail)]
    lasting = 10 * (light - around).mean(0)  # edges that stay on the lens
    stack = torch.stack([*over, lasting])
    return torch.cat([pictures.mean(0), stack, how_many(count, stack)])


def low_quantile(values: Tensor) -> Tensor:
    """The LOW quantile of values [K, ...] over the first dimension, one of them; NumPy sorts it fastest."""
    return torch.from_numpy(np.sort(values.numpy(), axis=0)[round(LOW * (len(values) - 1))])


def how_many(count: int, like: Tensor) -> Tensor:
    """The channel that tells how many photographs: [1, H, W]."""
    return like.new_full((1, *like.shape[1:]), float(np.log2(count)) / 5)


def statistics_of_capture(
    count: int, read: Callable[[int], NDArray[np.uint8]], hidden: Callable[[int], Ignored | None] = lambda _: None
) -> list[LensStatistics | None]:
    """For every photograph of a capture, in order of name, those of its lens.

    Photographs of one size count as of one lens. Long captures are taken in runs, since rain on a lens changes; only
    one run is in memory, at half the resolution. What masks hide counts as the mean of what others show there, or,
    where all hide a place, of what is read there.

    Args:
        count: how many photographs there are.
        read: the i-th one [H, W, 3], sRGB-encoded, 8 bits.
        hidden: its pixels [H, W] that are not to be looked at, None for none.

    Returns:
        None for a photograph that is the only one of its size in its run.
    """
    found: list[LensStatistics | None] = [None] * count
    for run in np.array_split(np.arange(count), max(1, -(-count // LONGEST_RUN))):
        halves = {int(i): _half(read(int(i)), hidden(int(i))) for i in run}
        for shape in {half.shape for half in halves.values()}:
            same = {i: half for i, half in halves.items() if half.shape == shape}
            if len(same) > 1:
                own = _of_run(np.stack(list(same.values())))
                for i in same:
                    found[i] = own
    return found


def _half(photograph: NDArray[np.uint8], hidden: Ignored | None) -> NDArray[np.uint8]:
    """At half the resolution, with where it is seen as a fourth channel: [H / 2, W / 2, 4], 8 bits."""
    seen = np.full(photograph.shape[:2], 255, np.uint8) if hidden is None else np.where(hidden, 0, 255).astype(np.uint8)
    planes = np.dstack([photograph, seen]).transpose(2, 0, 1)
    half = halved(torch.from_numpy(np.ascontiguousarray(planes))[None].float())[0]
    return half.round().to(torch.uint8).permute(1, 2, 0).numpy()


def _of_run(halves: NDArray[np.uint8]) -> LensStatistics:
    """Of pictures [K, H, W, 4], band by band."""
    height, bands, squares = halves.shape[1], [], []
    for top in range(0, height, BAND):
        bottom, above = min(top + BAND, height), min(top, BLUR)
        band = _visible(halves[:, top - above : bottom + BLUR])
        bands.append(fine_statistics(band)[:, above : above + bottom - top])
        squares.append(band[..., above : above + bottom - top, :].half())
    return LensStatistics(coarse_statistics(torch.cat(squares, dim=2).float()), torch.cat(bands, dim=1))


def _visible(halves: NDArray[np.uint8]) -> Tensor:
    """Pictures [K, 3, H, W] of pictures [K, H, W, 4] whose fourth channel says what is seen of them."""
    planes = torch.from_numpy(np.ascontiguousarray(halves.transpose(0, 3, 1, 2)))
    pictures, seen = planes[:, :3].float() / 255, planes[:, 3:] == 255
    if seen.all():
        return pictures
    count = seen.sum(0)
    mean = torch.where(count > 0, (pictures * seen).sum(0) / count.clamp_min(1), pictures.mean(0))
    return torch.where(seen, pictures, mean)
