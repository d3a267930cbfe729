"""Where the steps are calculated: on the CPU with our kernels, or on an NVIDIA GPU with gsplat."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.appearance.appearance import Dressed, dressed
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.rasterizer import Gradients, backward, backward_looks, render, render_looks
from baselines.splatting.objective import Objective
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
            duties: what the strategy asks for besides.
        """


class CpuBackend:
    """Our kernels."""

    device = "cpu"

    def __init__(
        self, objective: Objective, background: NDArray[np.float32], near: float, antialiased: bool = False
    ) -> None:
        self._objective = objective
        self._background = background
        self._workspace = BufferPool()
        self._how: dict[str, Any] = {"near": near, "antialiased": antialiased, "buffers": self._workspace}
        self._state: TrainingState | None = None

    def put(self, state: TrainingState) -> None:
        """Keep the arrays; steps change them in place."""
        self._state = state

    def get(self, iteration: int, seconds: float) -> TrainingState:
        """The same arrays."""
        assert self._state is not None
        return replace(self._state, iteration=iteration, seconds=seconds)

    def non_finite(self) -> int:
        """See Backend."""
        assert self._state is not None
        return int((~finite(self._state.gaussians)).sum())

    def residual(self, camera: Camera, view: int, degree: int) -> float:
        """See Backend."""
        assert self._state is not None
        shown = dressed(self._state.gaussians, self._objective.appearance, camera, view, degree)
        image, _ = render(shown, camera, self._background, min(degree, shown.sh_degree), **self._how)
        return self._objective.residual(image, view, self._workspace)

    def contributions(self, cameras: Sequence[Camera]) -> NDArray[np.float64]:
        """See Backend."""
        assert self._state is not None
        return contributions(self._state.gaussians, cameras, **self._how)

    def step(
        self, camera: Camera, view: int, iteration: int, degree: int, rates: Rates, step_options: StepOptions
    ) -> float:
        """See Backend."""
        state, buffers = self._state, self._workspace
        assert state is not None
        loss, gradients, rank = self._learn(state.gaussians, camera, view, iteration, degree)
        if step_options.watch:
            means2d = gradients.means2d_absolute if step_options.absolute else gradients.means2d
            observe(state, rank, means2d, (camera.width, camera.height))
        if step_options.opacity_penalty or step_options.scale_penalty:
            add_penalties(state.gaussians, step_options, gradients.parameters)
        moments = zip(state.first.state_dict().values(), state.second.state_dict().values(), strict=True)
        for (name, values), (first, second) in zip(state.gaussians.state_dict().items(), moments, strict=True):
            adam_step(values, getattr(gradients.parameters, name), first, second, iteration + 1, rates[name])
        if step_options.noise:
            add_noise(state.gaussians, step_options, buffers.array("noise", state.gaussians.means.shape))
        return loss

    def _learn(
        self, gaussians: Gaussians, camera: Camera, view: int, iteration: int, degree: int
    ) -> tuple[float, Gradients, NDArray]:
        """The loss of a view, its gradients, and ranks [N], negative where it shows nothing of a Gaussian.

        An appearance has taken its own step.
        """
        appearance, objective = self._objective.appearance, self._objective
        if appearance is None:
            image, state = render(gaussians, camera, self._background, degree, **self._how)
            loss, grad_image = objective(image, view, iteration, self._workspace)
            return loss, backward(state, grad_image), state.tiles.rank
        clothes = Dressed(gaussians, appearance, camera, view, degree)
        degree = min(degree, clothes.gaussians.sh_degree)
        images, state = render_looks(clothes.gaussians, clothes.sh, camera, self._background, degree, **self._how)
        loss, grad_images = objective.compare(list(images), view, iteration, self._workspace)
        gradients, by_looks = backward_looks(state, np.stack(grad_images))
        parameters = clothes.backward(gradients.parameters, by_looks, self._workspace)
        appearance.learn(iteration)
        means2d, absolute = (
            clothes.spread(getattr(gradients, name), name, self._workspace) for name in ("means2d", "means2d_absolute")
        )
        rank = clothes.spread(state.tiles.rank, "rank", self._workspace, rest=-1)
        return loss, Gradients(parameters, means2d, absolute), rank


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
