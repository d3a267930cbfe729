"""The objective of a training: the part of a splatting method that models rain."""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.masking.pixel_weights import Comparison, PixelWeights
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import Plane, Target, photometric_loss, prepare_target
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import Size, TrainingImages
from hydroviews.scene.images import Image

if TYPE_CHECKING:  # it needs torch, which most trainings do without
    from torch import Tensor

    from baselines.splatting.appearance.base import Appearance
    from baselines.splatting.gaussians import Gaussians


class OnGPU(NamedTuple):
    """What a GPU compares of a render, by the photometric loss, and what follows once it has the gradients."""

    image: "Tensor"  # [H, W, 3], differentiable by the render
    weights: "Tensor | None" = None  # [H, W], factors on each pixel's share of the loss; None where all are 1
    target: Target | None = None  # 8 bits, to compare with in place of the photograph, which hides what its mask does
    penalties: "Sequence[tuple[Tensor, float]]" = ()  # tensors whose means are part of the loss, and how much they are
    # called after the gradients are there, with the photograph's pixels, uint8, and which are shown [H, W]; None: all
    learn: "Callable[[Tensor, Tensor | None], None]" = lambda pixels, shown: None


class Objective:
    """The photometric loss against the photographs. Subclasses change the compared images or the loss.

    A subclass with learned parameters returns them from `state_dict` and restores them in `load_state_dict`, so that
    checkpoints hold them.
    """

    def __init__(
        self,
        images: TrainingImages,
        lambda_dssim: float = 0.2,
        appearance: "Appearance | None" = None,
        pixel_weights: PixelWeights | None = None,
    ):
        """Compare with the photographs.

        Args:
            images: the photographs.
            lambda_dssim: share of SSIM in the loss.
            appearance: what gives Gaussians their colours, where it is not spherical harmonics alone.
            pixel_weights: what weighs the pixels; None where all count alike.
        """
        self.images, self.lambda_dssim = images, lambda_dssim
        self.appearance, self.pixel_weights = appearance, pixel_weights

    @property
    def is_photometric(self) -> bool:
        """Whether it is the photometric loss of pixels that `weights` weighs, which a GPU calculates itself."""
        return self._is_as_here("__call__", "compare", "target")

    @property
    def wants_kernels(self) -> bool:
        """Whether something of it is calculated by the CPU's kernels, wherever Gaussians are rendered."""
        return not (self.is_photometric and self.pixel_weights is None and self._is_as_here("weights"))

    def _is_as_here(self, *names: str) -> bool:
        return all(getattr(type(self), name) is getattr(Objective, name) for name in names)

    @property
    def sh_sets(self) -> bool:
        """Whether steps render Gaussians in several sets of coefficients, which has kernels of its own."""
        return self.appearance is not None

    def target(self, view: int, size: Size | None = None) -> Target:
        """A training view prepared for the loss, at its own size or a smaller one."""
        return prepare_target(self.images.pixels(view, size), self.images.ignored(view, size))

    def wants_gaussians(self, view: int, iteration: int) -> bool:
        """Whether `see` is to be called before this view's step, or its validation; a GPU's have to be fetched."""
        return False

    def see(self, gaussians: "Gaussians", view: int, iteration: int) -> None:
        """Read the Gaussians before a step, for objectives that need more than the render; do not store them."""

    def weights(
        self, render: Callable[[], Image], view: int, size: Size, iteration: int, buffers: BufferPool
    ) -> Plane | None:
        """Factors [H, W] on each pixel's share of a training view's loss; None where all are 1.

        Args:
            render: gives the rendered view [H, W, 3], which a GPU then has to hand over.
            view: index of the training view.
            size: its height and width.
            iteration: of the training.
            buffers: memory to reuse.
        """
        if self.pixel_weights is None:
            return None
        return self.pixel_weights.weigh(self.comparison(render, view, size, iteration, buffers))

    def comparison(
        self, render: Callable[[], Image], view: int, size: Size, iteration: int, buffers: BufferPool
    ) -> Comparison:
        """A training view and its render, as pixel weights are asked for them; arguments as of `weights`."""
        target = self.target(view, size)
        losses = partial(_losses, render, target, self.lambda_dssim, buffers)
        return Comparison(view, iteration, target, render, losses)

    def on_gpu(self, render: "Tensor", view: int, iteration: int, buffers: BufferPool) -> OnGPU | None:
        """What a GPU compares of its render [H, W, 3] of a training view; None where that is left to `compare`."""
        if not self.is_photometric:
            return None
        from baselines.training.torch_state import fetched, sent

        size = render.shape[0], render.shape[1]
        weights = self.weights(cache(lambda: fetched(render)), view, size, iteration, buffers)
        return OnGPU(render, None if weights is None else sent(weights))

    def compare(
        self, images: Sequence[Image], view: int, iteration: int, buffers: BufferPool
    ) -> tuple[float, Sequence[Image]]:
        """The loss of a view's renders, one for each of `Appearance.sh_sets`, and its gradient by each of them."""
        loss, gradient = self(images[0], view, iteration, buffers)
        return loss, [gradient, *(np.zeros_like(image) for image in images[1:])]

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """The loss of a rendered training view, at its own size or a smaller one, and its gradient by the image.

        Args:
            image: rendered, [H, W, 3]; so is the gradient.
            view: index of the training view.
            iteration: of the training.
            buffers: memory to reuse.
        """
        size = image.shape[0], image.shape[1]
        weights = self.weights(lambda: image, view, size, iteration, buffers)
        return photometric_loss(image, self.target(view, size), self.lambda_dssim, weights, buffers)

    def residual(self, image: Image, view: int, buffers: BufferPool) -> float:
        """The loss of a rendered validation view; learns nothing from it."""
        return photometric_loss(image, self.target(view), self.lambda_dssim, buffers=buffers)[0]

    def report(self) -> dict[str, Any]:
        """Findings about the photographs, such as the kinds of rain: words, numbers or lists of words, for JSON."""
        return {} if self.pixel_weights is None else self.pixel_weights.report()

    def hidden(self, view: int, size: Size) -> Plane | None:
        """See Method: what is ignored beside the pixel weights' share; None if no pixels are."""
        return None

    def settings(self) -> dict[str, Any]:
        """What a checkpoint must agree with, beside the settings of the method."""
        return {"name": type(self).__name__, "lambda_dssim": self.lambda_dssim}

    def state_dict(self) -> dict[str, NDArray]:
        """Learned parameters other than the Gaussians."""
        learned = {} if self.appearance is None else self.appearance.training_state()
        weights = {} if self.pixel_weights is None else self.pixel_weights.state_dict()
        return prefixed("appearance", learned) | prefixed("weights", weights)

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Restore what `state_dict` returned."""
        if self.appearance is not None:
            self.appearance.load_training_state(below("appearance", arrays))
        if self.pixel_weights is not None:
            self.pixel_weights.load_state_dict(below("weights", arrays))


def _losses(render: Callable[[], Image], target: Target, lambda_dssim: float, buffers: BufferPool) -> Plane:
    """What each pixel of a render adds to the photometric loss [H, W]."""
    return loss_map(render(), target, lambda_dssim, buffers)
