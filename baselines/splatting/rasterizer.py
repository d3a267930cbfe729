"""The renderer: `render` an image of Gaussians, then carry an image gradient `backward` to their parameters."""

from dataclasses import dataclass, field, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import DTypeLike, NDArray

from baselines.splatting import binning, blending, blending_gradient, projection, projection_gradient
from baselines.splatting.constants import NEAR
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.spherical_harmonics import C0
from baselines.splatting.vectors import CONSTANTS
from hydroviews.cameras import Camera
from hydroviews.images import Image

BLACK = np.zeros(3, np.float32)
LARGE_IMAGE = 300_000  # pixels from which tiles of 32x32 are faster than 16x16


class Workspace:
    """Buffers by name that are kept between calls and only ever grow, so that a training loop allocates nothing."""

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray:
        """A contiguous array with undefined content; it is overwritten when the same name is asked for again."""
        size = int(np.prod(shape))
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < size:
            buffer = self._buffers[name] = np.empty(size + size // 4, dtype)
        return buffer[:size].reshape(shape)


@dataclass(frozen=True)
class RenderState:
    """What `backward` needs. Buffers belong to the workspace: the next `render` with it makes the state worthless."""

    gaussians: Gaussians
    sh_degree: int
    view: tuple[Any, ...]  # pose, centre, lens, width, height
    antialiased: bool
    background: NDArray[np.float32]
    depths: NDArray[np.float32]  # [N], infinite where culled
    order: NDArray[np.int32]  # visible Gaussians, nearest first
    rank: NDArray[np.int32]  # [N], place in that order; negative where culled
    packed: NDArray[np.float32]  # [n, 12] splats in that order
    tile_shift: int
    tile_start: NDArray[np.int32]
    tile_splats: NDArray[np.int32]
    tile_order: NDArray[np.int64]
    pair_start: NDArray[np.int32]
    pair_slot: NDArray[np.int32]
    transmittance: NDArray[np.float32]  # [H, W]; 1 - it is the image's alpha
    last: NDArray[np.float32]
    taken: NDArray[np.int32]
    workspace: Workspace = field(repr=False)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which Gaussians this view shows [N]."""
        return self.rank >= 0


@dataclass(frozen=True)
class Gradients:
    """dloss/dparameter, shaped like the parameters, and by the position on the image [N, 2] in pixels."""

    parameters: Gaussians
    means2d: NDArray[np.float32]
    means2d_absolute: NDArray[np.float32]  # the same with absolute values summed over pixels (Ye et al. 2024, AbsGS)

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
    workspace: Workspace | None = None,
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
        workspace: buffers to reuse; the image is one of them.

    Returns:
        The image and the state for `backward`.
    """
    workspace = workspace or Workspace()
    degree = gaussians.sh_degree if sh_degree is None else sh_degree
    if not 0 <= degree <= gaussians.sh_degree:
        raise ValueError(f"spherical-harmonic degree {degree}, the Gaussians hold 0 to {gaussians.sh_degree}")
    view = _view(gaussians, camera)
    n = len(gaussians)
    splats = workspace.array("splats", (n, projection.SPLAT_FLOATS))
    depths = workspace.array("depths", (n,))
    projection.project(*gaussians.arrays().values(), degree, *view, near, antialiased, splats, depths)
    background = np.asarray(background, np.float32)
    state = _bin(gaussians, degree, view, antialiased, background, splats, depths, workspace)
    image = workspace.array("image", (camera.height, camera.width, 3))
    blending.blend(*_tiles(state), state.transmittance, state.last, state.taken, image)
    return image, state


def backward(state: RenderState, grad_image: Image) -> Gradients:
    """Carry dloss/dimage [H, W, 3] back to the Gaussians that `render` was given.

    The arrays belong to the workspace of the render and are overwritten by the next call.
    """
    workspace = state.workspace
    moments = workspace.array("moments", (len(state.tile_splats), projection_gradient.MOMENTS))
    grad_image = np.ascontiguousarray(grad_image, np.float32)
    blending_gradient.blend_gradient(*_tiles(state), state.transmittance, state.last, state.taken, grad_image, moments)
    gaussians = state.gaussians
    gradients = {name: workspace.array(f"g_{name}", value.shape) for name, value in gaussians.arrays().items()}
    means2d, absolute = (workspace.array(name, (len(gaussians), 2)) for name in ("g_means2d", "g_absolute"))
    projection_gradient.project_gradient(
        *gaussians.arrays().values(),
        state.sh_degree,
        *state.view,
        state.antialiased,
        state.rank,
        state.pair_start,
        state.pair_slot,
        moments,
        *gradients.values(),
        means2d,
        absolute,
    )
    return Gradients(Gaussians(**gradients, origin=gaussians.origin), means2d, absolute)


def depth(state: RenderState) -> NDArray[np.float32]:
    """Mean depth [H, W] of what each pixel of a render shows, weighted as its colours are; NaN where nothing is.

    Along the viewing axis, in world units. How much of a pixel is covered is 1 - `state.transmittance`.
    """
    packed = state.packed.copy()
    packed[:, projection.RED] = state.depths[state.order]
    other = replace(state, packed=packed, background=BLACK)
    sums = np.empty((*state.transmittance.shape, 3), np.float32)
    scratch = (np.empty_like(plane) for plane in (state.transmittance, state.last, state.taken))
    blending.blend(*_tiles(other), *scratch, sums)
    covered = 1 - state.transmittance
    return np.divide(sums[..., 0], covered, out=np.full_like(covered, np.nan), where=covered > 0)


def _view(gaussians: Gaussians, camera: Camera) -> tuple[Any, ...]:
    pose = camera.world_to_camera.copy()
    pose[:3, 3] += pose[:3, :3] @ gaussians.origin
    centre = -pose[:3, :3].T @ pose[:3, 3]
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float64)
    return pose, centre, lens, camera.width, camera.height


def _bin(
    gaussians: Gaussians,
    degree: int,
    view: tuple[Any, ...],
    antialiased: bool,
    background: NDArray[np.float32],
    splats: NDArray[np.float32],
    depths: NDArray[np.float32],
    workspace: Workspace,
) -> RenderState:
    width, height = view[3:]
    total = len(gaussians)
    sort_keys = [workspace.array(name, (total,), np.uint32) for name in ("keys", "keys2")]
    sort_values = [workspace.array(name, (total,), np.int32) for name in ("order2", "order")]
    visible = binning.depth_order(depths, sort_keys[0], sort_values[0], sort_keys[1], sort_values[1])
    order = sort_values[1][:visible]

    shift = 5 if width * height >= LARGE_IMAGE else 4
    tiles_x, tiles_y = (width + (1 << shift) - 1) >> shift, (height + (1 << shift) - 1) >> shift
    tiles = tiles_x * tiles_y
    packed = workspace.array("packed", (visible, projection.SPLAT_FLOATS))
    rank = workspace.array("rank", (total,), np.int32)
    rank.fill(-1)
    counts = workspace.array("counts", (binning.BANDS, tiles), np.int32)
    counts.fill(0)
    pair_start = workspace.array("pair_start", (visible + 1,), np.int32)
    pair_start[-1] = 0
    tile_start = workspace.array("tile_start", (tiles + 1,), np.int32)
    binning.count_pairs(splats, order, shift, tiles_x, tiles_y, packed, rank, counts, pair_start)
    pairs = binning.lay_out(pair_start, counts, tile_start)
    tile_splats = workspace.array("tile_splats", (pairs,), np.int32)
    pair_slot = workspace.array("pair_slot", (pairs,), np.int32)
    binning.deal_pairs(packed, shift, tiles_x, tiles_y, counts, pair_start, tile_splats, pair_slot)
    return RenderState(
        gaussians=gaussians,
        sh_degree=degree,
        view=view,
        antialiased=antialiased,
        background=background,
        depths=depths,
        order=order,
        rank=rank,
        packed=packed,
        tile_shift=shift,
        tile_start=tile_start,
        tile_splats=tile_splats,
        tile_order=np.argsort(-np.diff(tile_start), kind="stable"),
        pair_start=pair_start,
        pair_slot=pair_slot,
        transmittance=workspace.array("transmittance", (height, width)),
        last=workspace.array("last", (height, width)),
        taken=workspace.array("taken", (tiles,), np.int32),
        workspace=workspace,
    )


def _tiles(state: RenderState) -> tuple[Any, ...]:
    return (
        state.packed,
        state.tile_start,
        state.tile_splats,
        state.tile_order,
        state.tile_shift,
        state.background,
        numba.get_num_threads(),
        CONSTANTS.ctypes.data,
    )
