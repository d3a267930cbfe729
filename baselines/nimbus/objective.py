"""What NimbusGS compares photographs with: the scene through the medium, and the view's residual (2026).

    I = R_scene T + P + R
    loss = photometric(I, photograph) + variation TV(extinction) + dark mean(dark channel of R_scene)

Depths, to which rays go, are constants: they are rendered anew now and then, and no gradient goes through them.
"""

import logging
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.nimbus.config import MediumConfig, NimbusConfig
from baselines.nimbus.losses import dark_loss, finite_or_zero, total_variation
from baselines.nimbus.medium import Medium, enlarged, through
from baselines.nimbus.residual import Residuals
from baselines.nimbus.view_rays import rays_of, small_camera
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Plane, photometric_loss
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import depth, render
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import TrainingImages
from baselines.training.torch_state import module_arrays, one_thread, restore_module
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

logger = logging.getLogger(__name__)
LEAST_COVERED = 0.5  # of a pixel by Gaussians, from which on it has a depth
DEPTH, MEDIUM, RESIDUAL = "depth", "medium", "residual"  # of names in a checkpoint
GIVEN_UP = "given_up"
SMALL = (16, 16)  # size at which the light that a medium takes of a view is averaged


class NimbusObjective(Objective):
    """The photometric loss of the scene behind a medium and residuals."""

    def __init__(
        self,
        images: TrainingImages,
        cameras: Sequence[Camera],
        config: NimbusConfig,
        medium: Medium | None,
        near: float,
    ) -> None:
        """An objective that knows nothing yet.

        Args:
            images: the photographs.
            cameras: of them.
            config: settings.
            medium: in its first state, on its device; None: there is none.
            near: depths are rendered of what is farther; world units.
        """
        super().__init__(images, config.splatting.lambda_dssim)
        self.cameras, self.medium, self._near = cameras, medium, near
        self._medium_settings, self._antialiased = config.medium or MediumConfig(), config.splatting.antialiased
        iterations = config.splatting.iterations
        shares = self._medium_settings.first, self._medium_settings.judged
        self._first, self._judged = (round(share * iterations) for share in shares)
        self.given_up = medium is None
        self.residuals = Residuals(config.residual, len(images), iterations)
        self._depths: dict[int, tuple[int, Plane]] = {}  # by view: iteration in which it was rendered, depth
        if medium is not None:
            self._adam = torch.optim.Adam(medium.parameters(), self._medium_settings.rate)

    def wants_gaussians(self, view: int, iteration: int) -> bool:
        """See Objective: for the view's depth."""
        if self.given_up or iteration < self._first:
            return False
        known = self._depths.get(view)
        return known is None or iteration - known[0] >= self._medium_settings.renewed

    def see(self, gaussians: Gaussians, view: int, iteration: int) -> None:
        """See Objective: renders the depth of a view, in small."""
        camera = small_camera(self.cameras[view], self._medium_settings.ray_shrink)
        _, state = render(gaussians, camera, sh_degree=0, near=self._near, antialiased=self._antialiased)
        found = np.where(1 - state.transmittance < LEAST_COVERED, np.float32(np.inf), depth(state))
        self._depths[view] = iteration, found.astype(np.float32)

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective; the medium takes a step."""
        self._judge(iteration)
        if self.medium is None or self.given_up or iteration < self._first:
            return self._compare(image, view, iteration, buffers)
        with one_thread(), torch.enable_grad():
            scene = torch.from_numpy(np.array(image)).to(self._device).requires_grad_()
            extinction = self.medium.extinction
            whole = finite_or_zero(scene)
            behind = self._behind(whole, view, extinction)
            loss, by_seen = self._compare(behind.detach().cpu().numpy(), view, iteration, buffers)
            more = self._medium_settings.variation * total_variation(extinction)
            more = more + self._medium_settings.dark * dark_loss(whole)
            torch.autograd.backward([behind, more], [torch.from_numpy(by_seen).to(behind), None])
            self._adam.step()
            self._adam.zero_grad()
        assert scene.grad is not None
        return loss + float(more.detach()), scene.grad.cpu().numpy()

    def residual(self, image: Image, view: int, buffers: BufferPool) -> float:
        """See Objective: behind the medium, without a residual, which is what a view of its own would have."""
        if self.medium is not None and view in self._depths and not self.given_up:
            with one_thread(), torch.no_grad():
                scene = torch.from_numpy(np.array(image)).to(self._device)
                image = self._behind(scene, view, self.medium.extinction).cpu().numpy()
        return photometric_loss(image, self.target(view), self.lambda_dssim, buffers=buffers)[0]

    def transmission(self, view: int, size: tuple[int, int]) -> Plane:
        """T [H, W] of a training view at (height, width); 1 where there is no medium."""
        if self.medium is None or self.given_up or view not in self._depths:
            return np.ones(size, np.float32)
        with one_thread(), torch.no_grad():
            return self._transmission(view, size, self.medium.extinction).cpu().numpy()

    def hidden(self, view: int, size: tuple[int, int]) -> Plane:
        """See Objective: 1 - T, and all of what is the residual's."""
        left = self.transmission(view, size)
        chosen = self.residuals.chosen.get(view)
        if chosen is not None:
            whole = torch.from_numpy(chosen.astype(np.float32))
            left = left * (1 - enlarged(whole, size).numpy())
        return np.clip(1 - left, 0, 1).astype(np.float32)

    def report(self) -> dict[str, str]:
        """See Objective: how much of the light the medium takes, and the share of the residuals' pixels."""
        medium = "none" if self.given_up else f"takes {self.light_taken():.1%} of the light"
        return {"medium": medium, "residuals": f"{self.residuals.share:.0%} of the pixels"}

    def light_taken(self) -> float:
        """1 - T, mean over the views whose depth is known; 0 where none is."""
        return float(np.mean([1 - self.transmission(view, SMALL).mean() for view in self._depths] or [0.0]))

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective: the medium, residuals, and depths."""
        arrays = {f"{DEPTH}.{view}.{made}": plane for view, (made, plane) in self._depths.items()}
        arrays |= prefixed(RESIDUAL, self.residuals.state_dict())
        if self.medium is not None:
            arrays |= prefixed(MEDIUM, module_arrays(self.medium, self._adam))
        return super().state_dict() | arrays | {GIVEN_UP: np.array([self.given_up], np.uint8)}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        super().load_state_dict(arrays)
        self.residuals.load_state_dict(below(RESIDUAL, arrays))
        self.given_up = bool(arrays[GIVEN_UP][0])
        self._depths = {}
        for name, plane in below(DEPTH, arrays).items():
            view, made = name.split(".")
            self._depths[int(view)] = int(made), plane.copy()
        if self.medium is not None:
            restore_module(self.medium, below(MEDIUM, arrays), self._adam)

    def _judge(self, iteration: int) -> None:
        """Give the medium up, when it is time, if it takes hardly any light: the air is clear."""
        if self.given_up or iteration != self._judged:
            return
        taken = self.light_taken()
        self.given_up = taken < self._medium_settings.least
        said = "given up" if self.given_up else "kept"
        logger.info(
            "nimbus: medium %s, it takes %.1f %% of the light after %d iterations", said, 100 * taken, iteration
        )

    @property
    def _device(self) -> torch.device:
        assert self.medium is not None
        return self.medium.field.device

    def _compare(self, seen: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """The loss of what scene and medium make of a view, beside its residual, and its gradient."""
        target = self.target(view, (seen.shape[0], seen.shape[1]))
        photograph = target.image
        chosen = self.residuals.of(photograph, seen, view, iteration, target.ignored)
        if chosen is None:
            return photometric_loss(seen, target, self.lambda_dssim, buffers=buffers)
        filled = np.where(chosen[..., None], photograph, seen)
        loss, gradient = photometric_loss(filled, target, self.lambda_dssim, buffers=buffers)
        gradient[chosen] = 0
        return loss, gradient

    def _transmission(self, view: int, size: tuple[int, int], extinction: Tensor) -> Tensor:
        assert self.medium is not None
        plane = self._depths[view][1]
        camera = self.cameras[view].resized(plane.shape[1], plane.shape[0])
        rays = rays_of(camera, plane, self.medium.box, self._device)
        return enlarged(self.medium.transmission(rays, extinction).reshape(plane.shape), size)

    def _behind(self, scene: Tensor, view: int, extinction: Tensor) -> Tensor:
        """A view [H, W, 3] of the scene as it is seen through the medium."""
        assert self.medium is not None
        share = self._transmission(view, (scene.shape[0], scene.shape[1]), extinction)
        return through(scene, share, self.medium.airlight)
