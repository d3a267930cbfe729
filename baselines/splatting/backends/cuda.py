"""The same training steps on an NVIDIA GPU with gsplat 1.5 (Ye et al. 2024).

Steps stay on the GPU, and the CPU waits once in each, and in gsplat for its number of pairs; refinement, every hundred
steps, is the CPU's: the state is copied over and back. gsplat lets a Gaussian cover 0.999 of a pixel where we stop at
0.99, so renders of very opaque scenes differ a little. Sets of colours are rendered one by one, so that absolute
gradients are those of each, added up; the kernels' are of the sum.
"""

import importlib.util
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import torch
from gsplat import rasterization
from numpy.typing import NDArray
from torch import Tensor

from baselines.splatting.appearance.gaussians import finite_rows, in_sight, moved
from baselines.splatting.backends import torch_ops
from baselines.splatting.backends.gsplat_kernels import require_kernels
from baselines.splatting.backends.torch_ops import (
    normal_noise,
    penalty_gradient,
    position_moves,
    without_non_finite,
)
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.constants import LOW_PASS
from baselines.splatting.kernels.splats.sh_coefficients import C0, degree_of
from baselines.splatting.objective import Objective, OnGPU
from baselines.splatting.state import TrainingState
from baselines.splatting.strategies.base import StepOptions
from baselines.training.images import Size
from baselines.training.torch_state import fetched, sent
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

logger = logging.getLogger(__name__)
Rows = slice | Tensor  # of the Gaussians that are rendered: all, or those at the indices [n]


@dataclass
class _DeviceState:
    """A TrainingState in GPU memory."""

    parameters: dict[str, Tensor]
    first: dict[str, Tensor]
    second: dict[str, Tensor]
    gradient_sum: Tensor
    seen: Tensor
    origin: NDArray[np.float64]
    residuals: tuple[float, ...]  # as in TrainingState
    non_finite: int  # likewise
    broken: Tensor  # int32 [1], 1 where a parameter may not be finite
    whole: bool  # whether it was 0 after the step before


def step_ops() -> ModuleType:
    """The loss and Adam: Triton's, which torch for CUDA on Linux brings along, or torch's own where it does not."""
    if importlib.util.find_spec("triton") is None:
        logger.warning("triton is not installed: a step takes about twice as long (pip install triton)")
        return torch_ops
    from baselines.splatting.backends import triton_ops

    return triton_ops


class CudaBackend:
    """gsplat's kernels; see backends.Backend."""

    def __init__(
        self, objective: Objective, background: NDArray[np.float32], near: float, antialiased: bool = False
    ) -> None:
        require_kernels()
        self.device = torch.cuda.get_device_name()
        self._objective = objective
        self._background = torch.from_numpy(background).cuda()
        self._near, self._mode = near, "antialiased" if antialiased else "classic"
        self._buffers = BufferPool()
        self._state: _DeviceState | None = None
        if objective.appearance is not None:
            objective.appearance.cuda()
        self._ops = step_ops()
        # SSIM is small differences of large filtered numbers, and convolutions may else have 10 bits of mantissa.
        torch.backends.cudnn.allow_tf32 = False
        self._rates: dict[str, tuple[NDArray[np.float32], Tensor]] = {}  # those uploaded last, and where they are
        self._targets: dict[tuple[int, Size], tuple[Tensor, Tensor | None]] = {}  # pixels, and which are shown

    def put(self, state: TrainingState) -> None:
        """Copy to the GPU."""
        parameters = _upload(state.gaussians)
        whole = bool(finite_rows(parameters).all())
        self._state = _DeviceState(
            parameters=parameters,
            first=_upload(state.first),
            second=_upload(state.second),
            gradient_sum=torch.from_numpy(state.gradient_sum).cuda(),
            seen=torch.from_numpy(state.seen).cuda(),
            origin=state.gaussians.origin,
            residuals=state.residuals,
            non_finite=state.non_finite,
            broken=torch.full((1,), not whole, dtype=torch.int32, device="cuda"),
            whole=whole,
        )

    def get(self, iteration: int, seconds: float) -> TrainingState:
        """Copy from the GPU."""
        state = self._current()
        return TrainingState(
            gaussians=self.gaussians(),
            first=_download(state.first, state.origin),
            second=_download(state.second, state.origin),
            gradient_sum=state.gradient_sum.cpu().numpy(),
            seen=state.seen.cpu().numpy(),
            iteration=iteration,
            seconds=seconds,
            residuals=state.residuals,
            non_finite=state.non_finite,
        )

    def gaussians(self) -> Gaussians:
        """See Backend."""
        state = self._current()
        return _download(state.parameters, state.origin)

    def non_finite(self) -> int:
        """See Backend."""
        return int((~finite_rows(self._current().parameters)).sum())

    def residual(self, camera: Camera, view: int, degree: int) -> float:
        """See Backend."""
        state = self._current()
        with torch.no_grad():
            _, scenes = self._sh_sets(state.parameters, camera, view, degree)
            image, _ = self._rasterize(scenes[0], state.origin, camera, degree)
        return self._objective.residual(image.cpu().numpy(), view, self._buffers)

    def contributions(self, cameras: Sequence[Camera]) -> NDArray[np.float64]:
        """See Backend: grey Gaussians, so that no colour is clamped."""
        state = self._current()
        total = torch.zeros(len(state.seen), dtype=torch.float64, device=state.seen.device)
        for camera in cameras:
            sh = torch.zeros_like(state.parameters["sh"][:, :1]).requires_grad_()
            image, _ = self._rasterize({**state.parameters, "sh": sh}, state.origin, camera, 0)
            image.sum().backward()
            assert sh.grad is not None
            total += sh.grad[:, 0, 0]
        return total.cpu().numpy() / C0

    def step(
        self, camera: Camera, view: int, iteration: int, degree: int, rates: dict[str, Any], step_options: StepOptions
    ) -> float:
        """See Backend."""
        state = self._current()
        leaves = {name: value.detach().requires_grad_() for name, value in state.parameters.items()}
        rows, scenes = self._sh_sets(leaves, camera, view, degree)
        options = {"absolute": step_options.absolute, "whole": state.whole}
        renders = [self._rasterize(scene, state.origin, camera, degree, **options) for scene in scenes]
        if step_options.watch:
            for _, details in renders:
                details["means2d"].retain_grad()
        loss = self._backward([image for image, _ in renders], view, iteration)
        if self._objective.appearance is not None:
            self._objective.appearance.learn(iteration)
        with torch.no_grad():
            if step_options.watch:
                _observe(state, rows, [details for _, details in renders], step_options, camera)
            for name in leaves:
                self._learn(name, leaves[name].grad, step_options, rates[name], iteration + 1)
            if step_options.noise:
                means = state.parameters["means"]
                noise = step_options.noise
                means += position_moves(state.parameters, noise, normal_noise(noise, means))
            told = torch.stack([loss, state.broken[0].to(loss.dtype)]).tolist()  # our one wait in a step
        state.whole = not told[1]
        return float(told[0])

    def render(self, gaussians: Gaussians, camera: Camera) -> Image:
        """An image with gsplat, to compare with ours."""
        with torch.no_grad():
            image, _ = self._rasterize(_upload(gaussians), gaussians.origin, camera, gaussians.sh_degree)
        return image.cpu().numpy()

    def _current(self) -> _DeviceState:
        assert self._state is not None
        return self._state

    def _learn(
        self, name: str, gradient: Tensor | None, options: StepOptions, rates: float | NDArray[np.float32], step: int
    ) -> None:
        """Adam's step of a parameter; where nothing is learned, moments go on falling."""
        state = self._current()
        values = state.parameters[name]
        parts = [part for part in (gradient, penalty_gradient(name, values, options)) if part is not None]
        total = sum(parts[1:], parts[0]) if parts else torch.zeros_like(values)
        moments = state.first[name], state.second[name]
        self._ops.adam_step(values, total, *moments, self._uploaded(name, rates), step, state.broken)

    def _uploaded(self, name: str, rates: float | NDArray[np.float32]) -> Tensor:
        """The rates of a parameter, uploaded where they are others than before."""
        wanted = np.asarray(rates, np.float32).reshape(-1)
        if name not in self._rates or not np.array_equal(self._rates[name][0], wanted):
            self._rates[name] = wanted.copy(), sent(wanted)
        return self._rates[name][1]

    def _sh_sets(
        self, parameters: dict[str, Tensor], camera: Camera, view: int, degree: int
    ) -> tuple[Rows, list[dict[str, Tensor]]]:
        """Which Gaussians are rendered, and their parameters with every set of coefficients: see `Appearance`."""
        appearance = self._objective.appearance
        if appearance is None:
            return slice(None), [parameters]
        seen_from = moved(camera, self._current().origin)
        rows, seen = in_sight(parameters, seen_from)
        return rows, [{**seen, "sh": sh} for sh in appearance.sh_sets(seen, seen_from, view, degree)]

    def _rasterize(
        self,
        parameters: dict[str, Tensor],
        origin: NDArray[np.float64],
        camera: Camera,
        degree: int,
        absolute: bool = False,
        whole: bool = False,
    ) -> tuple[Tensor, dict[str, Any]]:
        """An image, and what gsplat knows of it; `whole` if all parameters are known to be finite."""
        if not len(parameters["means"]):  # gsplat divides by their number
            return _background_alone(parameters, camera, self._background)
        pose = camera.world_to_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ origin
        matrices = sent(np.concatenate([pose.ravel(), camera.matrix.ravel()]).astype(np.float32))
        parameters, opacities = _opacities(parameters, whole)
        images, _, details = rasterization(
            parameters["means"],
            parameters["quaternions"],
            parameters["log_scales"].exp(),
            opacities,
            parameters["sh"],
            matrices[:16].reshape(1, 4, 4),
            matrices[16:].reshape(1, 3, 3),
            camera.width,
            camera.height,
            near_plane=self._near,
            rasterize_mode=self._mode,
            eps2d=LOW_PASS,
            sh_degree=min(degree, degree_of(parameters["sh"].shape[1])),
            packed=False,
            absgrad=absolute,
            backgrounds=self._background[None],
        )
        return images[0], details

    def _backward(self, renders: Sequence[Tensor], view: int, iteration: int) -> Tensor:
        """Backpropagate the objective: on the GPU where it is photometric there, else through its numpy gradients."""
        seen = self._objective.on_gpu(renders[0], view, iteration, self._buffers)
        if seen is not None:
            loss, gradient = self._photometric_loss(seen, view)
            more = [torch.full_like(values, weight / values.numel()) for values, weight in seen.penalties]
            torch.autograd.backward([seen.image, *(values for values, _ in seen.penalties)], [gradient, *more])
            seen.learn(*self._target(view, (seen.image.shape[0], seen.image.shape[1])))
            return loss
        pictures = [fetched(image) for image in renders]
        value, gradients = self._objective.compare(pictures, view, iteration, self._buffers)
        torch.autograd.backward(renders, [sent(gradient) for gradient in gradients])
        return torch.tensor(value, device=renders[0].device)

    def _photometric_loss(self, seen: OnGPU, view: int) -> tuple[Tensor, Tensor]:
        """The loss of what an objective shows of a render [H, W, 3], and its gradient by that."""
        image = seen.image.detach()
        target, shown = self._target(view, (image.shape[0], image.shape[1]))
        if seen.target is not None:
            target = torch.from_numpy(seen.target.pixels).cuda()
        return self._ops.photometric_loss(image, target, self._objective.lambda_dssim, shown, seen.weights)

    def _target(self, view: int, size: Size) -> tuple[Tensor, Tensor | None]:
        """A training view's pixels [H, W, 3], uint8, and which of them are shown [H, W]; uploaded once."""
        if (view, size) not in self._targets:
            ignored = self._objective.images.ignored(view, size)
            shown = None if ignored is None else torch.from_numpy(~ignored).cuda()
            self._targets[view, size] = torch.from_numpy(self._objective.images.pixels(view, size)).cuda(), shown
        return self._targets[view, size]


def _background_alone(
    parameters: dict[str, Tensor], camera: Camera, background: Tensor
) -> tuple[Tensor, dict[str, Any]]:
    """What `rasterization` would return of no Gaussians, whose gradients are as empty as they are."""
    means2d: Any = parameters["means"][None, :, :2] + 0
    means2d.absgrad = torch.zeros_like(means2d)
    nothing = means2d.sum() + sum(value.sum() for value in parameters.values())
    image = (background + nothing).expand(camera.height, camera.width, 3)
    return image, {"means2d": means2d, "radii": torch.zeros_like(means2d, dtype=torch.int32)}


def _observe(
    state: _DeviceState, rows: Rows, renders: Sequence[dict[str, Any]], step_options: StepOptions, camera: Camera
) -> None:
    shown = (renders[0]["radii"][0] > 0).all(dim=-1)
    means2d = [details["means2d"] for details in renders]
    gradient = sum((m.absgrad if step_options.absolute else m.grad)[0] for m in means2d)
    state.gradient_sum[rows] += _by_half_image(gradient, camera) * shown
    state.seen[rows] += shown


def _by_half_image(gradient: Any, camera: Camera) -> Tensor:
    """Lengths [N] of gradients by pixels [N, 2], by positions in units of half the image."""
    x, y = gradient.unbind(dim=-1)
    return torch.hypot(x * (camera.width / 2), y * (camera.height / 2))


def _opacities(parameters: dict[str, Tensor], whole: bool) -> tuple[dict[str, Tensor], Tensor]:
    """Parameters that can be rendered, and opacities [N], 0 of Gaussians that are not finite."""
    if whole:
        return parameters, parameters["opacity_logits"].sigmoid()
    parameters, finite = without_non_finite(parameters)
    return parameters, parameters["opacity_logits"].sigmoid() * finite


def _upload(gaussians: Gaussians) -> dict[str, Tensor]:
    return {name: torch.from_numpy(value).cuda() for name, value in gaussians.state_dict().items()}


def _download(tensors: dict[str, Tensor], origin: NDArray[np.float64]) -> Gaussians:
    return Gaussians(**{name: value.cpu().numpy() for name, value in tensors.items()}, origin=origin)
