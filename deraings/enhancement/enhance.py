"""Remove rain from a picture of any size with a trained network; large pictures are processed in overlapping tiles."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deraings.enhancement.architecture.lenses import Lens
from deraings.enhancement.architecture.mist_branch import without_mist_over_whole
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.weights import Enhancer, load_enhancer
from deraings.image_planes import Plane
from hydroviews.scene.images import Image

TILE = 768  # pixels along a side, beyond which a picture is taken in tiles
OVERLAP = 96  # pixels in which neighbouring tiles are blended


def enhance(
    image: Image,
    enhancer: Enhancer | None = None,
    tile: int = TILE,
    overlap: int = OVERLAP,
    remove_mist: bool = True,
    lens: Lens | None = None,
) -> Image:
    """Remove rain from a picture.

    Args:
        image: float32 [H, W, 3], sRGB-encoded, [0, 1], of any size.
        enhancer: the network; None for the shipped one.
        tile: largest side of a tile in pixels.
        overlap: overlap of neighbouring tiles in pixels, less than `tile`.
        remove_mist: remove mist from the whole picture first, if the network has that part. The network cannot separate
            mist on the lens from fog in the scene.
        lens: statistics of the lens over all its photographs; see `companions.lenses_of_companions`.

    Returns:
        An image of the same shape and range, computed on the network's device.

    Raises:
        ValueError: the shape is not [H, W, 3], or values are not finite.
        InputError: the shipped weights cannot be read.
    """
    network = (enhancer or shipped()).network
    return np.clip(_in_tiles(image, network, network.refine, (tile, overlap), remove_mist, lens), 0, 1)


class Enhanced(NamedTuple):
    """The predictions of the network for one picture."""

    picture: Image  # [H, W, 3], sRGB-encoded, [0, 1]
    cover: Image | None  # cover by streaks, drops and mist [H, W, 3], [0, 1]; None: not predicted
    error: Plane | None  # expected mean absolute error of `picture` [H, W]; None: not predicted


def predict(image: Image, enhancer: Enhancer, remove_mist: bool = True, lens: Lens | None = None) -> Enhanced:
    """`enhance`, with all other predictions of the network; the same arguments and errors."""
    network = enhancer.network

    def together(batch: Tensor, fine: Tensor | None) -> Tensor:
        return torch.cat([part for part in network.predict(batch, fine) if part is not None], dim=1)

    found = np.clip(_in_tiles(image, network, together, (TILE, OVERLAP), remove_mist, lens), 0, 1)
    cover = np.ascontiguousarray(found[..., 3:6]) if network.config.cover else None
    error = np.ascontiguousarray(found[..., -1]) if network.config.error else None
    return Enhanced(np.ascontiguousarray(found[..., :3]), cover, error)


Refine = Callable[[Tensor, Tensor | None], Tensor]  # [N, 3, h, w] and statistics of lenses to [N, C, h, w]


def _in_tiles(
    image: Image,
    network: EnhancementNetwork,
    refine: Refine,
    tiles: tuple[int, int],
    remove_mist: bool,
    lens: Lens | None,
) -> NDArray[np.float32]:
    """What `refine` makes of a picture without its mist, tile by tile: [H, W, C]."""
    if image.ndim != 3 or image.shape[2] != 3 or min(image.shape) < 1:
        raise ValueError(f"expected an image [H, W, 3], got shape {image.shape}")
    if not np.isfinite(image).all():
        raise ValueError("the image has values that are not finite")
    image = without_mist_on_lens(image, network, lens) if remove_mist else image
    tile, overlap = tiles
    weight = np.zeros((*image.shape[:2], 1), np.float32)
    total: NDArray[np.float32] | None = None
    for top, bottom in spans(image.shape[0], tile, overlap):
        for left, right in spans(image.shape[1], tile, overlap):
            batch = _batch(image[top:bottom, left:right], network.device)
            known = None if lens is None or lens.fine is None else lens.fine.to(batch.device)
            fine = None if known is None else known[None, :, _halves(top, bottom), _halves(left, right)]
            with torch.inference_mode():
                part = _image(padded(refine, network.multiple, batch, fine))
            total = np.zeros((*image.shape[:2], part.shape[2]), np.float32) if total is None else total
            ramp = _ramp(bottom - top, overlap)[:, None, None] * _ramp(right - left, overlap)[None, :, None]
            total[top:bottom, left:right] += ramp * part
            weight[top:bottom, left:right] += ramp
    assert total is not None  # a picture has a tile
    return total / weight


@cache
def shipped() -> Enhancer:
    """The shipped weights, read once."""
    return load_enhancer()


def spans(size: int, tile: int, overlap: int) -> list[tuple[int, int]]:
    """Starts and ends of tiles of equal length that cover `size` pixels and overlap by at least `overlap`.

    Raises:
        ValueError: tiles that are no longer than their overlap.
    """
    if tile <= overlap:
        raise ValueError(f"tiles of {tile} pixels cannot overlap by {overlap}")
    if size <= tile:
        return [(0, size)]
    count = -(-(size - overlap) // (tile - overlap))
    starts = np.rint(np.linspace(0, size - tile, count)).astype(int).tolist()
    return [(start, start + tile) for start in starts]


def _ramp(size: int, overlap: int) -> NDArray[np.float32]:
    """Weight [size] of a tile's pixels: rises from its ends within the overlap."""
    ends = np.minimum(np.arange(1, size + 1), np.arange(size, 0, -1))
    return np.minimum(ends / (overlap + 1), 1).astype(np.float32)


def _halves(start: int, end: int) -> slice:
    """The places at half the resolution of so many pixels, or one pixel before them."""
    return slice(start // 2, start // 2 + -(-(end - start) // 2))


def without_mist_on_lens(image: Image, network: EnhancementNetwork, lens: Lens | None) -> Image:
    """A picture [H, W, 3] without its mist, and nothing else done to it: not clipped; see `enhance`."""
    return without_mist(image, mist_on_lens(image, network, lens))


def mist_on_lens(image: Image, network: EnhancementNetwork, lens: Lens | None) -> Tensor | None:
    """The mist that a network predicts over a picture [H, W, 3]; that of the lens, where it is known.

    Returns:
        [4, 16, 16], see `mist_branch`; None where the network looks for none.
    """
    if lens is not None and lens.mist is not None:
        return lens.mist
    if not network.config.mist:
        return None
    with torch.inference_mode():
        return network.find_mist(_batch(image, network.device))[0]


def without_mist(image: Image, mist: Tensor | None) -> Image:
    """A picture [H, W, 3] without a mist from `mist_on_lens`: sRGB-encoded, not clipped above."""
    if mist is None:
        return image
    with torch.inference_mode():
        return _image(without_mist_over_whole(_batch(image, mist.device), mist[None]))


def _batch(image: Image, device: torch.device) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)[None].to(device)


def _image(batch: Tensor) -> Image:
    return np.ascontiguousarray(batch[0].permute(1, 2, 0).cpu().numpy(), np.float32)


def padded(refine: Refine, multiple: int, batch: Tensor, fine: Tensor | None = None) -> Tensor:
    """`refine` on pictures of any size, mirrored beyond two borders to multiples of what the network wants.

    Args:
        refine: see `Refine`.
        multiple: what height and width have to be multiples of.
        batch: the pictures [N, 3, H, W].
        fine: statistics of their lenses [N, FINE, H / 2, W / 2], rounded up, if they are known.
    """
    height, width = batch.shape[-2:]
    wanted = [size + -size % multiple for size in (height, width)]
    fine = None if fine is None else _continued(fine, [size // 2 for size in wanted])
    return refine(_continued(batch, wanted), fine)[..., :height, :width]


def _continued(batch: Tensor, wanted: Sequence[int]) -> Tensor:
    """Mirrored beyond the lower and the right border to the wanted height and width."""
    rows, columns = (mirrored(size, more) for size, more in zip(batch.shape[-2:], wanted, strict=True))
    return batch[..., rows, :][..., columns]


def mirrored(size: int, wanted: int) -> Tensor:
    """Indices [wanted] into `size` pixels that are continued by their mirror images, however few they are."""
    index = torch.arange(wanted) % (2 * size)
    return torch.minimum(index, 2 * size - 1 - index)
