"""What DeRainGS compares photographs with: the rendered scene as it is seen through the rain.

loss = photometric(model.forward(scene_image).image, photograph; weights of the pixels)

Behind mist that a network knows, every second one of the earlier steps compares the scene as it is with the photograph
that the network enhanced (`enhanced_target`).
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import Target, photometric_loss
from baselines.splatting.objective import Objective, OnGPU
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import Size, TrainingImages
from baselines.training.torch_state import fetched, sent
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, product
from deraings.masks.occlusion_masks import OcclusionMasks
from deraings.rain_model.model import RainConfig, RainModel
from deraings.rain_model.observation import Observation
from deraings.rain_model.on_gpu import RainOnGPU
from deraings.rain_model.report import report
from hydroviews.scene.images import Image
from hydroviews.scene.point_colours import PointColours


class RainObjective(Objective):
    """The photometric loss of the scene as it is seen through the rain."""

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig | None = None,
        lambda_dssim: float = 0.2,
        masks: OcclusionMasks | None = None,
        prior: EnhancedViews | None = None,
        points: Callable[[], PointColours] | None = None,
        covers: EnhancedViews | None = None,
    ) -> None:
        """An objective that knows nothing of the rain yet; what is not explained: see `RainModel`.

        Args:
            config: which kinds of rain are looked for; all of them by default.
            lambda_dssim: lambda of the photometric loss.
            masks: occlusion masks to be learned as well; they weigh the loss that the rain model leaves.
        """
        super().__init__(images, lambda_dssim)
        self.model = RainModel(images, iterations, config or RainConfig(), prior, points, covers)
        self.masks = masks
        self._on_gpu = RainOnGPU(self.model)

    def weights(
        self, render: Callable[[], Image], view: int, size: Size, iteration: int, buffers: BufferPool
    ) -> Plane | None:
        """See Objective: less behind what rain hides, as masks and a network have it; the masks learn, if due."""
        target = self.target(view, size)
        behind_drops = self.model.drop_weights(render, target, view, iteration)
        return product(behind_drops, self._mask_weights(render, target, view, size, iteration, buffers))

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective; learns of the rain as well. Pixels that are not finite count for nothing."""
        size = image.shape[0], image.shape[1]
        target = self.target(view, size)
        image, finite = _finite(image)
        self.model.begin(iteration)
        seen = self.model.forward(image, view, iteration, buffers)
        shown = product(target.shown, finite)
        left = self.weights(lambda: seen.image, view, size, iteration, buffers)
        weights = product(seen.weights, left, shown)
        enhanced = self.model.enhanced_target(view, size, iteration)
        if enhanced is not None:
            return photometric_loss(seen.scene_image, enhanced, self.lambda_dssim, weights, buffers)
        loss, gradient = photometric_loss(seen.image, target, self.lambda_dssim, weights, buffers)
        observed = Observation(target.image, target.shown, shown, weights)
        by_scene, by_mist = self.model.backward(seen, gradient, observed, buffers)
        self.model.update(seen, observed, by_mist, buffers)
        return loss, by_scene

    def on_gpu(self, render: Tensor, view: int, iteration: int, buffers: BufferPool) -> OnGPU:
        """See Objective; learns as `__call__` does."""
        self.model.begin(iteration)
        seen = self._on_gpu.forward(render, view, iteration)
        left = self.weights(cache(lambda: fetched(seen.image)), view, seen.size, iteration, buffers)
        weights = product(seen.weights, None if left is None else sent(left))
        enhanced = self.model.enhanced_target(view, seen.size, iteration)
        if enhanced is not None:
            return OnGPU(render, weights, enhanced)
        penalties = [(seen.mist.alpha, self.model.mist.mean_penalty)] if self.model.mist and seen.mist else []
        target = self.target(view, seen.size)
        learn = partial(self._on_gpu.update, seen, target, weights, buffers)
        return OnGPU(seen.image, weights, penalties=penalties, learn=learn)

    def residual(self, image: Image, view: int, buffers: BufferPool) -> float:
        """See Objective."""
        seen = self.model.forward(image, view, self.model.iterations, buffers)
        return photometric_loss(seen.image, self.target(view), self.lambda_dssim, buffers=buffers)[0]

    def hidden(self, view: int, size: Size) -> Plane:
        """How much of each pixel [H, W] of a view of (height, width) is taken for rain, or masked, after training."""
        model = self.model
        parts = model.mist_alpha, model.drop_alpha, model.seen_cover, model.rain_alpha
        covers = [cover(view, size) for cover in parts]
        if self.masks:
            covers.append(self.masks.mask(view, size))
        left = np.prod([1 - cover for cover in covers], axis=0)
        return np.clip(1 - left, 0, 1).astype(np.float32)

    def report(self) -> dict[str, Any]:
        """What was found of the rain, in the first, the middle and the last view; see `report`."""
        last = len(self.images) - 1
        shapes = {view: self.images.pixels(view).shape for view in (0, last // 2, last)}
        return report(self.model, self.masks, {view: (shape[0], shape[1]) for view, shape in shapes.items()})

    def settings(self) -> dict[str, Any]:
        """See Objective."""
        masks = self.masks.settings() if self.masks else None
        return {**super().settings(), **self.model.settings(), "masks": masks}

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective."""
        masks = self.masks.state_dict() if self.masks else {}
        return self.model.state_dict() | prefixed("masks", masks)

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        self.model.load_state_dict(arrays)
        if self.masks:
            self.masks.load_state_dict(below("masks", arrays))

    def _mask_weights(
        self, render: Callable[[], Image], target: Target, view: int, size: Size, iteration: int, buffers: BufferPool
    ) -> Plane | None:
        """1 - M [H, W] of a view, which the masks learn from first if they are due; None where nothing is masked."""
        if self.masks is None:
            return None
        if self.masks.due(iteration):
            self.masks.learn(view, loss_map(render(), target, self.lambda_dssim, buffers=buffers), iteration)
        return self.masks.weights(view, size, iteration)


def _finite(image: Image) -> tuple[Image, Plane | None]:
    """A render [H, W, 3] with 0 where a pixel is not finite, and 1 where it is [H, W]; None where all are."""
    finite = np.isfinite(image)
    if finite.all():
        return image, None
    finite = finite.all(axis=2)
    return np.where(finite[..., None], image, np.float32(0)), finite.astype(np.float32)
