"""The rain between scene and photograph where a GPU renders: the formulas of the CPU's kernels, in torch.

What is learned of the rain stays on the CPU: the mist's knots and a lens of 400 pixels are small, and what drops are
learned from is averaged down before it is downloaded. Gradients are torch's.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.splatting.kernels.photometric import Target
from baselines.training.images import Size
from baselines.training.torch_state import fetched, sent
from deraings.enhancement.architecture.mist_branch import decoded, encoded
from deraings.image_planes import CELLS, averages_around, product, within_side
from deraings.rain_model.drops import DropLayer
from deraings.rain_model.kernels import BRIGHTEST, BRIGHTEST_ENCODED, mix
from deraings.rain_model.mist import NOISE, Mist, spreading
from deraings.rain_model.model import DROPS, MIST, RainModel

MIX: Callable = mix.py_func  # type: ignore[attr-defined]  # the kernels' formula, of tensors
Matrix = Callable[[int, int], NDArray[np.float32]]  # makes one for a line of so many pixels and so many parts or knots


class MistOnGPU(NamedTuple):
    """A view's mist; knots and colour are what gradients are wanted by."""

    knots: Tensor  # sqrt(mist_alpha) [h, w]
    colour: Tensor  # linear light [3]
    alpha: Tensor  # mist_alpha [H, W]


class SeenOnGPU(NamedTuple):
    """A view seen through the rain; see `model.Seen`."""

    image: Tensor  # O [H, W, 3]
    without_drops: Tensor  # T [H, W, 3]
    rained: Tensor  # R [H, W, 3]
    rains: bool
    mist: MistOnGPU | None
    drop_alpha: Tensor | None  # [H, W]
    view: int
    iteration: int

    @property
    def size(self) -> Size:
        """Height and width."""
        return self.image.shape[0], self.image.shape[1]


class RainOnGPU:
    """`RainModel.forward` and `update` for renders of a GPU."""

    def __init__(self, model: RainModel) -> None:
        self._model = model
        self._matrices: dict[tuple[Matrix, int, int], Tensor] = {}  # those uploaded so far

    def forward(self, scene_image: Tensor, view: int, iteration: int) -> SeenOnGPU:
        """A rendered view [H, W, 3] through all that is known of the rain; see `RainModel.forward`."""
        size = scene_image.shape[0], scene_image.shape[1]
        model, seen, mist, drop_alpha = self._model, scene_image, None, None
        if model.rainfall:
            seen = behind_rain(seen, sent(model.rain_alpha(view, size)), model.rainfall.brightness)
        rained = seen
        if model.mist and model.counts(MIST, iteration):
            mist = self._mist(model.mist, model.mist.knots(view), size)
            seen = behind_mist(seen, mist)
        without_drops = seen
        if model.drops and model.counts(DROPS, iteration):
            lens = model.drops.size(view)
            layer = model.drops.layer(view, lens if _within(lens, size) else size)
            seen, drop_alpha = behind_drops(seen, self._surroundings(seen.detach()), layer)
        return SeenOnGPU(seen, without_drops, rained, model.rainfall is not None, mist, drop_alpha, view, iteration)

    def forward_enhanced(self, scene_image: Tensor, view: int, iteration: int) -> Tensor:
        """A rendered view [H, W, 3] through what the network leaves of the rain; see `RainModel.forward_enhanced`."""
        mist = self._model.mist
        if mist is None or not self._model.counts(MIST, iteration):
            return scene_image
        size = scene_image.shape[0], scene_image.shape[1]
        return behind_mist(scene_image, self._mist(mist, mist.left_knots(view), size))

    def update(
        self, seen: SeenOnGPU, target: Target, weights: Tensor | None, pixels: Tensor, shown: Tensor | None
    ) -> None:
        """Learn of the rain from a view, whose gradients are there.

        Args:
            seen: the view.
            target: its photograph.
            weights: factors [H, W] on each pixel's share of the loss.
            pixels: the photograph [H, W, 3], uint8.
            shown: which pixels of it are not hidden, [H, W]; None where all are shown.
        """
        model = self._model
        if model.drops and DROPS not in model.off and model.drops.due(seen.iteration):
            small = self._averaged(seen.without_drops.detach(), model.drops.size(seen.view), averaging)
            model.drops.update(target.image, fetched(small), seen.view, target.shown)
        if model.mist and seen.mist is not None and (seen.rains or seen.mist.knots.grad is not None):
            learning = seen.mist
            if seen.rains:
                passing = None if seen.drop_alpha is None else 1 - seen.drop_alpha
                gradient = difference_gradient(seen.image.detach(), pixels, product(weights, shown, passing))
                learning = self._mist_with_gradient(model.mist, seen, gradient)
            knots, colour = (_gradient(values) for values in (learning.knots, learning.colour))
            model.mist.update(model.mist.with_priors(seen.view, knots, colour), seen.iteration)

    def _mist_with_gradient(self, mist: Mist, seen: SeenOnGPU, gradient: Tensor) -> MistOnGPU:
        """The mist with gradients of another loss, of which `gradient` [H, W, 3] is that by the view behind mist."""
        again = self._mist(mist, mist.knots(seen.view), seen.size)
        torch.autograd.backward(behind_mist(seen.rained.detach(), again), gradient)
        return again

    def _averaged(self, image: Tensor, size: Size, kind: Matrix) -> Tensor:
        """A picture [H, W, 3] averaged over the areas of (height, width) pixels, as `kind` has it."""
        rows, columns = (self._matrix(kind, pixels, n) for pixels, n in zip(image.shape[:2], size, strict=True))
        return torch.einsum("hH,HWc,wW->hwc", rows, image, columns)

    def _surroundings(self, image: Tensor) -> Tensor:
        """See `image_planes.surroundings`."""
        size = image.shape[0], image.shape[1]
        around = self._averaged(image, within_side(size, CELLS), averaging_around)
        return enlarged(around.permute(2, 0, 1), size).permute(1, 2, 0)

    def _mist(self, mist: Mist, at_knots: NDArray[np.float32], size: Size) -> MistOnGPU:
        """The mist of a view of (height, width), of which sqrt(mist_alpha) is known at the knots [h, w]."""
        knots, colour = (sent(values.copy()).requires_grad_() for values in (at_knots, mist.colour))
        rows, columns = (self._matrix(spreading, pixels, n) for pixels, n in zip(size, knots.shape, strict=True))
        return MistOnGPU(knots, colour, (rows @ knots @ columns.T).square())

    def _matrix(self, kind: Matrix, pixels: int, n: int) -> Tensor:
        if (kind, pixels, n) not in self._matrices:
            self._matrices[kind, pixels, n] = sent(kind(pixels, n).copy())
        return self._matrices[kind, pixels, n]


def behind_rain(image: Tensor, alpha: Tensor, brightness: float) -> Tensor:
    """A view [H, W, 3] behind rain of alpha [H, W] and encoded value `brightness`."""
    return MIX(alpha[..., None], image, brightness)


def behind_mist(image: Tensor, mist: MistOnGPU) -> Tensor:
    """A view [H, W, 3] behind mist, mixed in linear light; exactly the view where there is none."""
    alpha = mist.alpha[..., None]
    light = MIX(alpha, decoded(_clipped(image, float(BRIGHTEST_ENCODED))), mist.colour)
    return torch.where(alpha > 0, encoded(_clipped(light, float(BRIGHTEST))), image)


def difference_gradient(seen: Tensor, pixels: Tensor, weights: Tensor | None) -> Tensor:
    """See `mist.difference_gradient`; the photograph [H, W, 3] is uint8."""
    gradient = ((seen - pixels.to(seen) / 255) / NOISE).clamp(-1, 1) / seen.numel()
    return gradient if weights is None else gradient * weights[..., None]


def behind_drops(image: Tensor, around: Tensor, layer: DropLayer) -> tuple[Tensor, Tensor]:
    """A view [H, W, 3] behind drops, and their alpha [H, W]; see `DropLayer.forward`.

    Args:
        image: the view.
        around: its surroundings [H, W, 3], which no gradient goes back through.
        layer: the drops, no larger than the view.
    """
    planes = sent(np.concatenate([layer.alpha[None], np.moveaxis(layer.light, 2, 0)]))
    alpha, *light = enlarged(planes, (image.shape[0], image.shape[1]))
    return MIX(alpha[..., None], image, around) + torch.stack(light, dim=2), alpha


def enlarged(planes: Tensor, size: Size) -> Tensor:
    """Planes [C, h, w] at (height, width), linear between pixels, as `image_planes.resized` where they are smaller."""
    return functional.interpolate(planes[None], size, mode="bilinear", align_corners=False)[0]


def averaging(pixels: int, n: int) -> NDArray[np.float32]:
    """What each of n equal parts of a line takes of each of its pixels, [n, pixels]; a part's shares sum to 1."""
    edges, places = np.linspace(0, pixels, n + 1), np.arange(pixels)
    overlap = np.minimum(edges[1:, None], places + 1) - np.maximum(edges[:-1, None], places)
    return (np.maximum(overlap, 0) * n / pixels).astype(np.float32)


def averaging_around(pixels: int, n: int) -> NDArray[np.float32]:
    """What the means of the parts around each of n equal parts of a line take of its pixels, [n, pixels]."""
    return averages_around(n) @ averaging(pixels, n)


def _clipped(x: Tensor, most: float) -> Tensor:
    """Within [0, most], with a gradient of 1 everywhere: slopes do not end where values are clipped."""
    return x + (x.clamp(0, most) - x).detach()


def _gradient(values: Tensor) -> NDArray[np.float32]:
    assert values.grad is not None
    return fetched(values.grad)


def _within(small: tuple[int, ...], size: Size) -> bool:
    return small[0] <= size[0] and small[1] <= size[1]
