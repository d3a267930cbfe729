"""The renderer: `render` an image of Gaussians, then carry an image gradient `backward` to their parameters.

    image = blend(bin(project(Gaussians, camera))),      dloss/dGaussians = project'(blend'(dloss/dimage))

`render_sh_sets` and `backward_sh_sets` do it for several sets of spherical-harmonic coefficients of the same Gaussians
at once: where they are and what they cover is calculated once.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import SHAPE, Gaussians
from baselines.splatting.kernels import adam
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.chunks import CHUNKS
from baselines.splatting.kernels.constants import NEAR
from baselines.splatting.kernels.splats import projection, projection_gradient
from baselines.splatting.kernels.splats.sh_coefficients import C0, degree_of
from baselines.splatting.kernels.tiles import blending, blending_gradient
from baselines.splatting.kernels.tiles.blending import GRID, TILE_PIXELS
from baselines.splatting.kernels.tiles.splat_lists import Splats, Tiles, bin_splats
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

BLACK = np.zeros(3, np.float32)


@dataclass(frozen=True)
class RenderState:
    """What `backward` needs. Arrays are buffers of the pool: the next `render` with it overwrites them."""

    gaussians: Gaussians
    sh: NDArray[np.float32]  # [L, N, K, 3], every set of coefficients; not the Gaussians' own
    sh_degree: int
    view: tuple[Any, ...]  # pose, centre, lens, width, height
    antialiased: bool
    background: NDArray[np.float32]
    splats: Splats
    tiles: Tiles
    blocks_transmittance: NDArray[np.float32]  # [tiles, 256], block by block
    blocks_last: NDArray[np.int32]
    buffers: BufferPool = field(repr=False)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which Gaussians this view shows [N]."""
        shown = np.zeros(len(self.gaussians), np.bool_)
        shown[self.order] = True
        return shown

    @property
    def order(self) -> NDArray[np.int32]:
        """The Gaussians that this view shows [n], nearest first."""
        return self.splats.gaussians[self.tiles.order]

    @property
    def transmittance(self) -> NDArray[np.float32]:
        """What every pixel lets through to the background [H, W]; 1 - it is the image's alpha."""
        return blending.by_pixel(self.blocks_transmittance, *self.view[3:])

    @property
    def last(self) -> NDArray[np.int32]:
        """Number of the last splat that each pixel took [H, W], from 1 in its tile's list."""
        return blending.by_pixel(self.blocks_last, *self.view[3:])


@dataclass(frozen=True)
class ShapeGradients:
    """dloss/dparameter of all but the colours, and by the position on the image [N, 2] in pixels."""

    means: NDArray[np.float32]  # [N, 3]
    quaternions: NDArray[np.float32]  # [N, 4]
    log_scales: NDArray[np.float32]  # [N, 3]
    opacity_logits: NDArray[np.float32]  # [N]
    means2d: NDArray[np.float32]
    means2d_absolute: NDArray[np.float32]  # the same with absolute values summed over pixels (Ye et al. 2024, AbsGS)


@dataclass(frozen=True)
class Gradients:
    """dloss/dparameter, shaped like the parameters, and by the position on the image [N, 2] in pixels."""

    parameters: Gaussians
    means2d: NDArray[np.float32]
    means2d_absolute: NDArray[np.float32]  # as in ShapeGradients

    @property
    def colours(self) -> NDArray[np.float32]:
        """By the colours [N, 3] that the Gaussians were given, see `Gaussians.coloured`."""
        return self.parameters.sh[:, 0] / np.float32(C0)


def render(
    gaussians: Gaussians,
    camera: Camera,
    background: NDArray[np.float32] = BLACK,
    sh_degree: int | None = None,
    *,
    near: float = NEAR,
    antialiased: bool = False,
    buffers: BufferPool | None = None,
) -> tuple[Image, RenderState]:
    """The image [H, W, 3] that a camera sees; not clipped above 1.

    Args:
        gaussians: the scene.
        camera: pose and intrinsics; a far `gaussians.origin` is taken out of the pose in float64.
        background: colour [3] behind everything.
        sh_degree: at most what the Gaussians hold, which is the default.
        near: Gaussians with nearer centres are left out, in world units.
        antialiased: whether Gaussians smaller than a pixel become fainter as they are widened to it (Yu et al. 2024,
            Mip-Splatting): a scene then looks the same from farther away than it was learned from.
        buffers: memory to reuse; the image is one of them.

    Returns:
        The image and the state for `backward`.
    """
    options: dict[str, Any] = {"near": near, "antialiased": antialiased, "buffers": buffers}
    images, state = render_sh_sets(gaussians, gaussians.sh[None], camera, background, sh_degree, **options)
    return images[0], state


def render_sh_sets(
    gaussians: Gaussians,
    sh: NDArray[np.float32],
    camera: Camera,
    background: NDArray[np.float32] = BLACK,
    sh_degree: int | None = None,
    *,
    near: float = NEAR,
    antialiased: bool = False,
    buffers: BufferPool | None = None,
) -> tuple[NDArray[np.float32], RenderState]:
    """Images [L, H, W, 3]: the Gaussians with each of the coefficients sh [L, N, K, 3] in place of their own.

    For the rest see `render`; the state is for `backward_sh_sets`.
    """
    buffers = buffers or BufferPool()
    sets, n, most = len(sh), len(gaussians), degree_of(sh.shape[2])
    degree = most if sh_degree is None else sh_degree
    if not 0 <= degree <= most:
        raise ValueError(f"spherical-harmonic degree {degree}, the Gaussians hold 0 to {most}")
    if sh.shape[1] != n:
        raise ValueError(f"coefficients {sh.shape} of {n} Gaussians, expected [sets, {n}, K, 3]")
    view = _view(gaussians, camera)
    splats = Splats(
        buffers.array("splats", (n, projection.COLOURS + 3 * sets)),
        buffers.array("depths", (n,)),
        buffers.array("gaussians", (n,), np.int32),
        buffers.array("chunk_counts", (CHUNKS,), np.int32),
    )
    shape = (getattr(gaussians, name) for name in SHAPE)
    outputs = splats.values, splats.depths, splats.gaussians, splats.counts
    projection.project(*shape, sh, degree, *view, near, antialiased, *outputs)
    tiles = bin_splats(splats, camera.width, camera.height, buffers)
    planes = len(tiles.heaviest), TILE_PIXELS
    state = RenderState(
        gaussians=gaussians,
        sh=sh,
        sh_degree=degree,
        view=view,
        antialiased=antialiased,
        background=np.asarray(background, np.float32),
        splats=splats,
        tiles=tiles,
        blocks_transmittance=buffers.array("transmittance", planes),
        blocks_last=buffers.array("last", planes, np.int32),
        buffers=buffers,
    )
    images = buffers.array("images", (sets, camera.height, camera.width, 3))
    blending.blend(*_blending_arguments(state), images)
    return images, state


def backward(state: RenderState, grad_image: Image) -> Gradients:
    """Carry dloss/dimage [H, W, 3] back to the Gaussians that `render` was given.

    The arrays are buffers of the render's pool: the next call overwrites them.
    """
    return backward_sh_sets(state, grad_image[None])[0]


def backward_sh_sets(state: RenderState, grad_images: NDArray[np.float32]) -> tuple[Gradients, NDArray[np.float32]]:
    """Carry dloss/dimages [L, H, W, 3] back to what `render_sh_sets` was given.

    Returns:
        The gradients by the Gaussians, whose coefficients are the first set, and by all sets [L, N, K, 3]: buffers
        of the pool, as those of `backward` are.
    """
    g_sh = state.buffers.array("g_sh", state.sh.shape)
    shape = _backward(state, grad_images, (g_sh.reshape(-1),))
    parameters = Gaussians(**{name: getattr(shape, name) for name in SHAPE}, sh=g_sh[0], origin=state.gaussians.origin)
    return Gradients(parameters, shape.means2d, shape.means2d_absolute), g_sh


def backward_with_sh_step(
    state: RenderState,
    grad_image: Image,
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    step: int,
    rates: NDArray[np.float32],
) -> ShapeGradients:
    """As `backward`, but the coefficients take a step of Adam at once: their gradient, most of all, is never written.

    Args:
        state: of `render`, whose Gaussians' coefficients [N, K, 3] change in place.
        grad_image: dloss/dimage [H, W, 3].
        first, second: Adam's moments of the coefficients [N, K, 3]; they change in place. Those above the degree in
            use are zero: `projection_gradient.project_gradient` leaves them out.
        step: number of this step, from 1.
        rates: learning rates [K, 3].
    """
    row, constants = adam.settings(step, rates)
    return _backward(state, grad_image[None], (first.reshape(-1), second.reshape(-1), row, constants))


def _backward(
    state: RenderState, grad_images: NDArray[np.float32], sh_output: tuple[NDArray[np.float32], ...]
) -> ShapeGradients:
    """The gradients of all but the coefficients; for those see `project_gradient`'s `form`."""
    buffers, gaussians, tiles, splats = state.buffers, state.gaussians, state.tiles, state.splats
    moments = buffers.array("moments", (tiles.pairs, blending_gradient.moments_of(len(state.sh))))
    blending_gradient.blend_gradient(
        *_blending_arguments(state), np.ascontiguousarray(grad_images, np.float32), moments
    )
    shape = [getattr(gaussians, name) for name in SHAPE]
    outputs = {name: buffers.array(f"g_{name}", getattr(gaussians, name).shape) for name in SHAPE}
    outputs |= {name: buffers.array(f"g_{name}", (len(gaussians), 2)) for name in ("means2d", "means2d_absolute")}
    projection_gradient.project_gradient(
        *shape,
        state.sh,
        state.sh_degree,
        *state.view,
        state.antialiased,
        splats.values,
        splats.gaussians,
        splats.counts,
        tiles.pair_start,
        tiles.pair_end,
        moments,
        *outputs.values(),
        sh_output,
    )
    return ShapeGradients(**outputs)


def depth(state: RenderState) -> NDArray[np.float32]:
    """Mean depth [H, W] of what each pixel of a render shows, weighted as its colours are; NaN where nothing is.

    Along the viewing axis, in world units. How much of a pixel is covered is 1 - `state.transmittance`.
    """
    values = state.splats.values[:, : projection.COLOURS + 3].copy()
    values[:, projection.COLOURS] = state.splats.depths
    other = replace(
        state,
        splats=replace(state.splats, values=values),
        tiles=replace(state.tiles, records=state.tiles.records.copy()),
        background=BLACK,
        blocks_transmittance=np.empty_like(state.blocks_transmittance),
        blocks_last=np.empty_like(state.blocks_last),
    )
    width, height = state.view[3:]
    sums = np.empty((1, height, width, 3), np.float32)
    blending.blend(*_blending_arguments(other), sums)
    covered = 1 - state.transmittance
    return np.divide(sums[0, ..., 0], covered, out=np.full_like(covered, np.nan), where=covered > 0)


def _view(gaussians: Gaussians, camera: Camera) -> tuple[Any, ...]:
    pose = camera.world_to_camera.copy()
    pose[:3, 3] += pose[:3, :3] @ gaussians.origin
    centre = -pose[:3, :3].T @ pose[:3, 3]
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float64)
    return pose, centre, lens, camera.width, camera.height


def _blending_arguments(state: RenderState) -> tuple[Any, ...]:
    tiles, values = state.tiles, state.splats.values
    return (
        values,
        tiles.start,
        tiles.records,
        tiles.heaviest,
        GRID,
        state.background,
        numba.get_num_threads(),
        (0,) * ((values.shape[1] - projection.COLOURS) // 3),
        state.blocks_transmittance,
        state.blocks_last,
    )
