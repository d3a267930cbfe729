"""The pixels that a field learns from: drawn from the training views by seed and iteration alone."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.training.images import TrainingImages
from baselines.volumetric.rays.rays import CameraArrays
from baselines.volumetric.rays.spaces import Rays, Space
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator


@dataclass(frozen=True)
class Batch:
    """R pixels and their rays."""

    rays: Rays
    colours: Tensor  # [R, 3] in [0, 1]
    weights: Tensor  # [R] in [0, 1]: how much each counts
    views: Tensor  # [R], index of the training view
    places: Tensor | None = None  # [R, 2], row and column of the pixel centres in (0, 1), where a method needs them


class TrainingPixels:
    """All pixels of the training views with their weights."""

    def __init__(
        self,
        cameras: Sequence[Camera],
        images: TrainingImages,
        weights: Sequence[NDArray[np.float32]] | None = None,
    ):
        """Gather them.

        Args:
            cameras: of the training views.
            images: of the same views; what their masks hide has weight 0.
            weights: [H, W] a view, in [0, 1]; everything counts 1 where none are given.

        Raises:
            InputError: weights of another number or size than the images, or outside [0, 1]; nothing that counts.
        """
        if weights is not None:
            _check_weights(weights, images)
        self.images, self._cameras = images, CameraArrays(cameras)
        self._widths = np.array([camera.width for camera in cameras])
        self._heights = np.array([camera.height for camera in cameras])
        sizes = np.array([camera.width * camera.height for camera in cameras])
        self._ends = np.cumsum(sizes)
        self._starts = self._ends - sizes
        self._colours = images.all_pixels()
        self._weights = _counting(images, weights)
        if self._weights is not None and not self._weights.any():
            raise InputError(
                "the training views: no pixel counts",
                found="weights of the method itself that are 0 wherever the photographs are not masked",
                fix="take another method, or settings with which it hides less",
            )

    def digest(self) -> str:
        """SHA-256 of all weights, of nothing where all count 1; that of the pixels is `images.digest()`."""
        return hashlib.sha256(b"" if self._weights is None else self._weights.tobytes()).hexdigest()

    def draw(self, seed: int, iteration: int, rays: int, space: Space, device: torch.device) -> Batch:
        """Pixels drawn evenly from all views; those with weight 0 are drawn too, and do not count."""
        chosen = generator(seed, "rays", iteration).integers(0, self._ends[-1], rays)
        views = np.searchsorted(self._ends, chosen, side="right")
        rows, columns = np.divmod(chosen - self._starts[views], self._widths[views])
        return self.at(views, rows, columns, space, device)

    def at(
        self,
        views: NDArray[np.int64],
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        space: Space,
        device: torch.device,
    ) -> Batch:
        """Pixels by view, row and column, each [R]."""
        chosen = self._starts[views] + rows * self._widths[views] + columns
        world = self._cameras.rays(views, columns + 0.5, rows + 0.5)
        colours = torch.from_numpy(self._colours[chosen]).to(device).float() / 255
        weights = torch.ones(len(chosen)) if self._weights is None else torch.from_numpy(self._weights[chosen])
        places = np.stack([(rows + 0.5) / self._heights[views], (columns + 0.5) / self._widths[views]], axis=1)
        return Batch(
            space.from_world(world, device),
            colours,
            weights.to(device),
            torch.from_numpy(views).to(device),
            torch.from_numpy(places.astype(np.float32)).to(device),
        )


# By pixels, seed, iteration, number of rays, space and device; by default evenly from all views.
Draw = Callable[[TrainingPixels, int, int, int, Space, torch.device], Batch]


def _counting(images: TrainingImages, weights: Sequence[NDArray[np.float32]] | None) -> NDArray[np.float32] | None:
    """How much every pixel of all views counts; None where all count 1, which are spared the memory."""
    hidden = [images.ignored(view) for view in range(len(images))]
    if weights is None and all(mask is None for mask in hidden):
        return None
    parts = []
    for view, mask in enumerate(hidden):
        part = np.ones(images.pixels(view).shape[:2], np.float32) if weights is None else weights[view]
        parts.append((part if mask is None else np.where(mask, np.float32(0), part)).ravel())
    return np.concatenate(parts)


def _check_weights(weights: Sequence[NDArray[np.float32]], images: TrainingImages) -> None:
    expected = [images.pixels(view).shape[:2] for view in range(len(images))]
    found = [weight.shape for weight in weights]
    if found != expected:
        raise InputError("weights of the pixels: not those of the views", found=found[:3], expected=expected[:3])
    if not all(np.isfinite(weight).all() and weight.min() >= 0 and weight.max() <= 1 for weight in weights):
        raise InputError("weights of the pixels: out of range", expected="numbers from 0 to 1")
