"""Where the steps are calculated: on the CPU with our kernels, or on an NVIDIA GPU with gsplat."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.appearance.gaussians import AppearanceGaussians, gaussians_in_view
from baselines.splatting.gaussians import SHAPE, Gaussians
from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import (
    ShapeGradients,
    backward_sh_sets,
    backward_with_sh_step,
    render,
    render_sh_sets,
)
from baselines.splatting.state import TrainingState, finite
from baselines.splatting.strategies.base import StepOptions
from baselines.splatting.strategies.densification import observe
from baselines.splatting.strategies.pruning import contributions
from baselines.splatting.strategies.relocation import add_noise, add_penalties
from baselines.training.devices import chosen_device
from hydroviews.scene.cameras import Camera

GSPLAT = "gsplat"  # what splatting needs on a GPU beside torch
Rates = dict[str, float | NDArray[np.float32]]


class Backend(Protocol):
    """One place to calculate. The trainer owns the loop, the schedule and the strategy."""

    device: str  # "cpu", or the GPU's name

    def put(self, state: TrainingState) -> None:
        """Take over a state to go on from; call it again after every refinement."""

    def get(self, iteration: int, seconds: float) -> TrainingState:
        """The state as numpy arrays, valid until the next step."""

    def gaussians(self) -> Gaussians:
        """The Gaussians of the state alone, valid until the next step."""

    def non_finite(self) -> int:
        """How many Gaussians have a parameter that is NaN or infinite; none of them is shown or learns."""

    def residual(self, camera: Camera, view: int, degree: int) -> float:
        """The loss of a view, without a step."""

    def contributions(self, cameras: Sequence[Camera]) -> NDArray[np.float64]:
        """Blending weights of the Gaussians [N], summed over all pixels of all cameras; see `pruning`."""

    def step(
        self, camera: Camera, view: int, iteration: int, degree: int, rates: Rates, step_options: StepOptions
    ) -> float:
        """Render a training view, compare, and take one step of Adam; returns the loss.

        Args:
            camera: of the view.
            view: its index, for the objective.
            iteration: from 0.
            degree: spherical-harmonic degree in use.
            rates: from `schedule.rates_at`.
            step_options: what the strategy asks for besides.
        """


class CpuBackend:
    """Our kernels."""

    device = "cpu"

    def __init__(
        self, objective: Objective, background: NDArray[np.float32], near: float, antialiased: bool = False
    ) -> None:
        self._objective = objective
        self._background = background
        self._buffers = BufferPool()
        self._render_options: dict[str, Any] = {"near": near, "antialiased": antialiased, "buffers": self._buffers}
        self._state: TrainingState | None = None

    def put(self, state: TrainingState) -> None:
        """Keep the arrays; steps change them in place."""
        self._state = state

    def get(self, iteration: int, seconds: float) -> TrainingState:
        """The same arrays."""
        assert self._state is not None
        return replace(self._state, iteration=iteration, seconds=seconds)

    def gaussians(self) -> Gaussians:
        """See Backend: the same arrays."""
        assert self._state is not None
        return self._state.gaussians

    def non_finite(self) -> int:
        """See Backend."""
        assert self._state is not None
        return int((~finite(self._state.gaussians)).sum())

    def residual(self, camera: Camera, view: int, degree: int) -> float:
        """See Backend."""
        assert self._state is not None
        shown = gaussians_in_view(self._state.gaussians, self._objective.appearance, camera, view, degree)
        image, _ = render(shown, camera, self._background, min(degree, shown.sh_degree), **self._render_options)
        return self._objective.residual(image, view, self._buffers)

    def contributions(self, cameras: Sequence[Camera]) -> NDArray[np.float64]:
        """See Backend."""
        assert self._state is not None
        return contributions(self._state.gaussians, cameras, **self._render_options)

    def step(
        self, camera: Camera, view: int, iteration: int, degree: int, rates: Rates, step_options: StepOptions
    ) -> float:
        """See Backend."""
        state, buffers = self._state, self._buffers
        assert state is not None
        if self._objective.appearance is None:
            learned = self._learn(state, camera, view, iteration, degree, rates)
        else:
            learned = self._learn_with_appearance(state.gaussians, camera, view, iteration, degree)
        if step_options.watch:
            means2d = learned.means2d_absolute if step_options.absolute else learned.means2d
            observe(state, learned.visible, means2d, (camera.width, camera.height))
        if step_options.opacity_penalty or step_options.scale_penalty:
            add_penalties(state.gaussians, step_options, learned.gradients)
        for name in learned.names:
            parts = (state.gaussians, learned.gradients, state.first, state.second)
            values, gradient, first, second = (getattr(part, name) for part in parts)
            adam_step(values, gradient, first, second, iteration + 1, rates[name])
        if step_options.noise:
            add_noise(state.gaussians, step_options.noise, buffers.array("noise", state.gaussians.means.shape))
        return learned.loss

    def _learn(
        self, state: TrainingState, camera: Camera, view: int, iteration: int, degree: int, rates: Rates
    ) -> "Learned":
        """Of a view as it is; the coefficients have taken their step."""
        image, rendered = render(state.gaussians, camera, self._background, degree, **self._render_options)
        loss, grad_image = self._objective(image, view, iteration, self._buffers)
        sh_moments = state.first.sh, state.second.sh
        shape = backward_with_sh_step(rendered, grad_image, *sh_moments, iteration + 1, np.asarray(rates["sh"]))
        return Learned(loss, shape, SHAPE, shape.means2d, shape.means2d_absolute, rendered.visible)

    def _learn_with_appearance(
        self, gaussians: Gaussians, camera: Camera, view: int, iteration: int, degree: int
    ) -> "Learned":
        """Of a view in the colours that the appearance gives it, which has taken its own step."""
        appearance, buffers = self._objective.appearance, self._buffers
        assert appearance is not None
        shown = AppearanceGaussians(gaussians, appearance, camera, view, degree)
        degree = min(degree, shown.gaussians.sh_degree)
        images, rendered = render_sh_sets(
            shown.gaussians, shown.sh, camera, self._background, degree, **self._render_options
        )
        loss, grad_images = self._objective.compare(list(images), view, iteration, buffers)
        gradients, by_sh_sets = backward_sh_sets(rendered, np.stack(grad_images))
        parameters = shown.backward(gradients.parameters, by_sh_sets, buffers)
        appearance.learn(iteration)
        means2d, absolute = (
            shown.spread(getattr(gradients, name), name, buffers) for name in ("means2d", "means2d_absolute")
        )
        visible = shown.spread(rendered.visible, "visible", buffers)
        return Learned(loss, parameters, tuple(parameters.state_dict()), means2d, absolute, visible)


@dataclass(frozen=True)
class Learned:
    """What a view says: its loss, and the gradients that parameters have yet to follow."""

    loss: float
    gradients: ShapeGradients | Gaussians
    names: tuple[str, ...]  # of the parameters that follow them
    means2d: NDArray[np.float32]  # by the position on the image in pixels [N, 2]
    means2d_absolute: NDArray[np.float32]  # the same with absolute values summed over pixels
    visible: NDArray[np.bool_]  # which Gaussians the view shows [N]


def make_backend(
    device: str, objective: Objective, background: NDArray[np.float32], near: float, antialiased: bool = False
) -> Backend:
    """The backend for a device; $HYDROVIEWS_DEVICE, where it is set, comes before the configuration.

    Raises:
        InputError: an unknown device, or "cuda" without a GPU or without gsplat.
    """
    if chosen_device(device, GSPLAT) == "cuda":
        from baselines.splatting.backends.cuda import CudaBackend

        return CudaBackend(objective, background, near, antialiased)
    return CpuBackend(objective, background, near, antialiased)
