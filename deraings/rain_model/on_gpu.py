"""The rain between scene and photograph where a GPU renders: the formulas of the CPU's kernels, in torch.

What is learned of the rain stays on the CPU: the mist's knots and a lens of 400 pixels are small, and what drops are
learned from is averaged down before it is downloaded. Only steps that falling rain is learned from, one in a hundred,
take the CPU's way. Gradients are torch's.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Target
from baselines.training.images import Size
from baselines.training.torch_state import fetched, sent
from deraings.enhancement.mist_branch import decoded, encoded
from deraings.image_planes import CELLS, Plane, averages_around, product, within_side
from deraings.rain_model.drops import DropLayer
from deraings.rain_model.mist import NOISE, Mist, spreading
from deraings.rain_model.mist_kernels import BRIGHTEST, BRIGHTEST_ENCODED
from deraings.rain_model.model import RainModel
from deraings.rain_model.observation import Observation

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
    scene_image: Tensor  # B [H, W, 3]
    mist: MistOnGPU | None
    drop_alpha: Tensor | None  # [H, W]
    weights: Tensor | None  # [H, W]: 0 where drops hide the scene
    view: int
    iteration: int

    @property
    def size(self) -> Size:
        """Height and width."""
        return self.image.shape[0], self.image.shape[1]

    @property
    def rains(self) -> bool:
        """Whether falling rain is part of what is seen."""
        return self.rained is not self.scene_image


class RainOnGPU:
    """`RainModel.forward` and `update` for renders of a GPU."""

    def __init__(self, model: RainModel) -> None:
        self._model = model
        self._matrices: dict[tuple[Matrix, int, int], Tensor] = {}  # those uploaded so far

    def forward(self, scene_image: Tensor, view: int, iteration: int) -> SeenOnGPU:
        """A rendered view [H, W, 3] through all that is known of the rain; see `RainModel.forward`."""
        size = scene_image.shape[0], scene_image.shape[1]
        model, alpha, mist = self._model, self._rain_alpha(view, size), None
        seen = scene_image
        if model.rain and alpha is not None:
            seen = behind_rain(seen, alpha, model.rain.layer.brightness)
        rained = seen
        if model.mist and model.mist.due(iteration):
            mist = self._mist(model.mist, view, size)
            seen = behind_mist(seen, mist)
        without_drops, drop_alpha, weights, layer = seen, None, None, self._drop_layer(view, size, iteration)
        if layer is not None:
            seen, drop_alpha, weights = behind_drops(seen, self._surroundings(seen.detach()), layer)
        return SeenOnGPU(seen, without_drops, rained, scene_image, mist, drop_alpha, weights, view, iteration)

    def update(
        self,
        seen: SeenOnGPU,
        target: Target,
        weights: Tensor | None,
        buffers: BufferPool,
        pixels: Tensor,
        shown: Tensor | None,
    ) -> None:
        """Learn of the rain from a view, whose gradients are there.

        Args:
            seen: the view.
            target: its photograph.
            weights: factors [H, W] on each pixel's share of the loss.
            buffers: to reuse.
            pixels: the photograph [H, W, 3], uint8.
            shown: which pixels of it are not hidden, [H, W]; None where all are shown.
        """
        model = self._model
        if model.rain and model.rain.due(seen.view, seen.size, seen.iteration):
            self._update_on_cpu(seen, target, weights, buffers)
        elif model.drops and model.drops.due(seen.iteration):
            small = self._averaged(seen.without_drops.detach(), model.drops.size(seen.view), averaging)
            model.drops.update(target.image, fetched(small), seen.view, target.shown)
        if model.mist and seen.mist is not None:
            learning = seen.mist
            if seen.rains and model.mist.sure_in_rain:
                passing = None if seen.drop_alpha is None else 1 - seen.drop_alpha
                told = difference_gradient(seen.image.detach(), pixels, product(weights, shown, passing))
                learning = self._mist_told(model.mist, seen, told)
            knots, colour = (_gradient(values) for values in (learning.knots, learning.colour))
            model.mist.update(model.mist.learned_from(seen.view, knots, colour), seen.iteration)

    def _mist_told(self, mist: Mist, seen: SeenOnGPU, told: Tensor) -> MistOnGPU:
        """The mist with gradients of another loss: `told` [H, W, 3], its gradient by what is seen through mist."""
        again = self._mist(mist, seen.view, seen.size)
        misted, penalty = behind_mist(seen.rained.detach(), again), mist.mean_penalty / again.alpha.numel()
        torch.autograd.backward([misted, again.alpha], [told, torch.full_like(again.alpha, penalty)])
        return again

    def _update_on_cpu(self, seen: SeenOnGPU, target: Target, weights: Tensor | None, buffers: BufferPool) -> None:
        """All but mist, from the view as the CPU's kernels show it."""
        on_cpu = self._model.forward(fetched(seen.scene_image), seen.view, seen.iteration, buffers)
        factors: Plane | None = None if weights is None else fetched(weights)
        if target.shown is not None:
            factors = target.shown if factors is None else factors * target.shown
        observed = Observation(target.image, target.shown, target.shown, factors)
        self._model.update(on_cpu, observed, None, buffers)

    def _rain_alpha(self, view: int, size: Size) -> Tensor | None:
        """rain_alpha [H, W], or [1, 1] where it is the same everywhere; None where there is none."""
        rain = self._model.rain
        if rain is None or not rain.even_alpha:
            return None
        deviation = rain.deviation(view)
        if deviation is None:
            return sent(np.full((1, 1), rain.even_alpha, np.float32))
        if not _within(deviation.shape, size):
            alpha, _ = rain.alpha(view, size)
            return None if alpha is None else sent(alpha)
        return (rain.even_alpha + enlarged(sent(deviation)[None], size)[0]).clamp(0, rain.max_alpha)

    def _drop_layer(self, view: int, size: Size, iteration: int) -> DropLayer | None:
        """The drops of a view, no larger than it."""
        drops = self._model.drops
        if drops is None:
            return None
        lens = drops.size(view)
        return drops.layer(view, lens if _within(lens, size) else size, iteration)

    def _averaged(self, image: Tensor, size: Size, kind: Matrix) -> Tensor:
        """A picture [H, W, 3] averaged over the areas of (height, width) pixels, as `kind` has it."""
        rows, columns = (self._matrix(kind, pixels, n) for pixels, n in zip(image.shape[:2], size, strict=True))
        return torch.einsum("hH,HWc,wW->hwc", rows, image, columns)

    def _surroundings(self, image: Tensor) -> Tensor:
        """See `image_planes.surroundings`."""
        size = image.shape[0], image.shape[1]
        around = self._averaged(image, within_side(size, CELLS), averaging_around)
        return enlarged(around.permute(2, 0, 1), size).permute(1, 2, 0)

    def _mist(self, mist: Mist, view: int, size: Size) -> MistOnGPU:
        """The mist of a view of (height, width)."""
        knots, colour = (sent(values.copy()).requires_grad_() for values in (mist.knots(view), mist.colour))
        rows, columns = (self._matrix(spreading, pixels, n) for pixels, n in zip(size, knots.shape, strict=True))
        return MistOnGPU(knots, colour, (rows @ knots @ columns.T).square())

    def _matrix(self, kind: Matrix, pixels: int, n: int) -> Tensor:
        if (kind, pixels, n) not in self._matrices:
            self._matrices[kind, pixels, n] = sent(kind(pixels, n).copy())
        return self._matrices[kind, pixels, n]


def behind_rain(image: Tensor, alpha: Tensor, brightness: float) -> Tensor:
    """A view [H, W, 3] behind rain of alpha [H, W] or [1, 1] and encoded value `brightness`."""
    return (1 - alpha[..., None]) * image + brightness * alpha[..., None]


def behind_mist(image: Tensor, mist: MistOnGPU) -> Tensor:
    """A view [H, W, 3] behind mist, mixed in linear light; exactly the view where there is none."""
    alpha = mist.alpha[..., None]
    light = (1 - alpha) * decoded(_clipped(image, float(BRIGHTEST_ENCODED))) + alpha * mist.colour
    return torch.where(alpha > 0, encoded(_clipped(light, float(BRIGHTEST))), image)


def difference_gradient(seen: Tensor, pixels: Tensor, weights: Tensor | None) -> Tensor:
    """See `mist.difference_gradient`; the photograph [H, W, 3] is uint8."""
    gradient = ((seen - pixels.to(seen) / 255) / NOISE).clamp(-1, 1) / seen.numel()
    return gradient if weights is None else gradient * weights[..., None]


def behind_drops(image: Tensor, around: Tensor, layer: DropLayer) -> tuple[Tensor, Tensor, Tensor]:
    """A view [H, W, 3] behind drops, their alpha [H, W], and factors [H, W] on each pixel's share of the loss.

    See `DropLayer.forward`.

    Args:
        image: the view.
        around: its surroundings [H, W, 3], which no gradient goes back through.
        layer: the drops, no larger than the view.
    """
    planes = sent(np.concatenate([layer.alpha[None], np.moveaxis(layer.light, 2, 0)]))
    alpha, *light = enlarged(planes, (image.shape[0], image.shape[1]))
    fall = ((layer.hidden - alpha) / (layer.hidden - layer.shown)).clamp(0, 1)
    cover = alpha[..., None]
    seen = (1 - cover) * image + cover * around + torch.stack(light, dim=2)
    return seen, alpha, fall * fall * (3 - 2 * fall)


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
