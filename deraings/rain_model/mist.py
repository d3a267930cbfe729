"""Mist on the lens: a smooth veil that is the same in every view while the scene is not, learned with the scene.

A view is R = encode((1 - V(x)) decode(B) + V(x) a) (see `rain_light`), B the rendered scene. V lies on a coarse grid
over the picture, at a few moments of the film between which it changes steadily, views in order of name being taken
one after another; V and the colour a are learned by Adam from the gradient of the photometric loss. A pilot that did
so in encoded values regained 9.7 of the 10.6 dB that drops and mist had cost.

What the photographs cannot tell: a veil that is equally dense everywhere is as good as a scene of less contrast. A
penalty on the mean of V decides for the scene, so that a veil's thinnest place is clear. Nor can they tell thin mist
of bright light from thicker mist of less: a is held near what mist should look like (`mist_light`). Nothing in space
can take the rest of the veil's place: real fog and white walls move over the lens as the camera moves. A sky that is
always in the same corner does not; but mist only adds light, and V a cannot be lighter than the darkest that a place of
the lens ever shows. That bound, less its own smallest value, is where V starts from. Where every place of the lens
shows something dark now and then, there is no mist, and none is looked for; nor where scene points grow paler with
distance and not with where the lens shows them (`mist_evidence`): then it is foggy in the scene.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.rain_model.mist_bounds import mist_bounds
from deraings.rain_model.mist_config import VeilConfig
from deraings.rain_model.mist_kernels import veiled, veiled_gradient, warm_up
from deraings.rain_model.mist_or_fog import is_mist, paleness_of
from deraings.rain_model.moments import moment_weights
from hydroviews.scene.images import Image
from hydroviews.scene.point_colours import PointColours

SENSIBLE = 1e-3  # V at least as thick learns; none at all would have no gradient


class Veil:
    """The share V and the colour of mist on the lens, and how they are learned."""

    def __init__(
        self,
        pictures: Sequence[NDArray[np.uint8]],
        iterations: int,
        config: VeilConfig,
        hidden: Sequence[NDArray[np.bool_] | None] = (),
        points: Callable[[], PointColours] | None = None,
    ) -> None:
        """Look for mist in the photographs.

        Args:
            pictures: [H, W, 3] each, in order of name.
            iterations: of the training.
            config: how mist is learned.
            hidden: masks [H, W] of pixels that are not looked at.
            points: looks up scene points in the pictures, asked where there may be mist. Without, or where there are
                too few, what may be mist is taken for mist.
        """
        self._config, self._n_views, self._iterations = config, len(pictures), iterations
        self._first = round(config.start * iterations)
        bounds = mist_bounds(pictures, config, hidden)
        self.expected = bounds.colour  # a, before anything is learned
        self.colour = self.expected.copy()  # a [3], linear light
        self.evidence = paleness_of(bounds, points) if bounds.suspected and points is not None else None
        self.wanted = bounds.suspected and (self.evidence is None or is_mist(self.evidence, config))
        if self.wanted:
            warm_up()
        self._most = np.sqrt(np.minimum(config.slack * bounds.thickest, config.thickest))  # sqrt(V)
        likely = config.likely * bounds.possible + SENSIBLE
        self.roots = (np.minimum(np.sqrt(likely), self._most) * self.wanted).astype(np.float32)  # sqrt(V) at the knots
        self._adam = {name: np.zeros(shape, np.float32) for name, shape in self._moment_shapes().items()}

    def due(self, iteration: int) -> bool:
        """Whether mist is looked for in this step."""
        return iteration >= self._first and self.wanted

    def share(self, view: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """V [H, W] of a training view."""
        roots = np.tensordot(self._weights(view), self.roots, 1)
        return np.square(_spread(roots, size))

    def apply(self, image: Image, view: int, buffers: BufferPool) -> Image:
        """The rendered view [H, W, 3] seen through the mist."""
        return veiled(image, self.share(view, (image.shape[0], image.shape[1])), self.colour, buffers)

    def learn(self, image: Image, view: int, gradient: Image, iteration: int, buffers: BufferPool) -> Image:
        """One step of Adam; returns the gradient by the image.

        Args:
            image: as given to `apply`, [H, W, 3].
            view: likewise.
            gradient: of the loss by what `apply` returned.
            iteration: from 0.
            workspace: the result is one of its buffers.
        """
        config, size = self._config, (image.shape[0], image.shape[1])
        weights = self._weights(view)
        root = _spread(np.tensordot(weights, self.roots, 1), size)
        g_image, g_share, g_colour = veiled_gradient(image, np.square(root), self.colour, gradient, buffers)
        penalised = g_share + np.float32(config.penalty / root.size)
        by_knot = weights[:, None, None] * _gather(2 * root * penalised, self.roots.shape[1:])
        by_knot += np.float32(config.roughness / self.roots[0].size) * roughness_gradient(self.roots)
        g_colour += np.float32(2 * config.colour_penalty) * (self.colour - self.expected)
        decay = config.final ** (iteration / max(self._iterations, 1))
        self._step("roots", self.roots, by_knot, iteration, config.rate * decay)
        self._step("colour", self.colour, g_colour, iteration, config.colour_rate * decay)
        np.clip(self.roots, 0, self._most, out=self.roots)
        np.clip(self.colour, 0, 1, out=self.colour)
        return g_image

    def state_dict(self) -> dict[str, NDArray]:
        """All that is learned, for checkpoints."""
        return {"roots": self.roots, "colour": self.colour, **self._adam}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
        self.roots, self.colour = arrays["roots"].copy(), arrays["colour"].copy()
        self._adam = {name: arrays[name].copy() for name in self._adam}

    def _weights(self, view: int) -> NDArray[np.float32]:
        return moment_weights(view, self._n_views, len(self.roots))

    def _moment_shapes(self) -> dict[str, tuple[int, ...]]:
        learnt = {"roots": self.roots.shape, "colour": self.colour.shape}
        return {f"{name}.{order}": shape for name, shape in learnt.items() for order in ("first", "second")}

    def _step(self, name: str, values: NDArray, gradient: NDArray, iteration: int, rate: float) -> None:
        first, second = self._adam[f"{name}.first"], self._adam[f"{name}.second"]
        step = iteration - self._first + 1
        adam_step(values, np.ascontiguousarray(gradient, np.float32), first, second, step, rate)


def roughness_gradient(knots: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of half the sum of squared differences of neighbouring knots [T, h, w], in space and in time."""
    gradient = np.zeros_like(knots)
    for axis in range(3):
        steps = np.diff(knots, axis=axis)
        before = [(1, 0) if a == axis else (0, 0) for a in range(3)]
        after = [(0, 1) if a == axis else (0, 0) for a in range(3)]
        gradient += np.pad(steps, before) - np.pad(steps, after)
    return gradient


def _spread(knots: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Values of a grid [h, w] at all pixels [H, W]: bilinear, outermost knots on the picture's edge."""
    rows, columns = (_hats(pixels, n) for pixels, n in zip(size, knots.shape, strict=True))
    return rows @ knots @ columns.T


def _gather(plane: NDArray[np.float32], grid: tuple[int, ...]) -> NDArray[np.float32]:
    """The transpose of `_spread`: from a gradient by pixels [H, W] to one by knots [h, w]."""
    rows, columns = (_hats(pixels, n) for pixels, n in zip(plane.shape, grid, strict=True))
    return rows.T @ plane @ columns


def _hats(pixels: int, knots: int) -> NDArray[np.float32]:
    """Weights [pixels, knots] of linear interpolation."""
    place = (np.arange(pixels) + 0.5) / pixels * (knots - 1)
    return np.maximum(0, 1 - np.abs(place[:, None] - np.arange(knots))).astype(np.float32)
