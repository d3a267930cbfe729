"""From the pixels of a view to points in space, by the depth of what has been learned so far (Wild-GS)."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splatting.gaussians import SHAPE, Gaussians
from baselines.splatting.rasterizer import depth, render
from hydroviews.scene.cameras import Camera

LEAST_COVERED = 0.5  # of a pixel by Gaussians, from which on it has a depth


def rendered_depth(
    parameters: dict[str, Tensor], camera: Camera, near: float, antialiased: bool
) -> NDArray[np.float32]:
    """Depth [H, W] along the viewing axis; NaN where Gaussians cover less than half of a pixel.

    Always by the CPU's kernels.

    Args:
        parameters: of the Gaussians in sight, see `Appearance.sh_sets`.
        camera: of the view, relative to their origin.
        near: nothing nearer is shown; world units.
        antialiased: as trained.
    """
    shape = {name: np.ascontiguousarray(parameters[name].detach().cpu().numpy()) for name in SHAPE}
    grey = Gaussians(**shape, sh=np.zeros((len(shape["means"]), 1, 3), np.float32))
    _, state = render(grey, camera, near=near, antialiased=antialiased)
    found = depth(state)
    return np.where(1 - state.transmittance < LEAST_COVERED, np.float32(np.nan), found)


def lifted(depths: Tensor, camera: Camera) -> Tensor:
    """Points [H W, 3] that pixels of given depth [H, W] show, row by row; NaN where there is no depth."""
    across, down = (torch.from_numpy(slopes).to(depths) for slopes in camera.slopes)
    local = torch.stack([across * depths, down[:, None] * depths, depths], dim=-1).reshape(-1, 3)
    pose = torch.from_numpy(camera.world_to_camera).to(depths)
    return (local - pose[:3, 3]) @ pose[:3, :3]


def lifted_size(height: int, width: int, longest: int) -> tuple[int, int]:
    """Height and width of the picture that is lifted: the photograph's, or smaller so that none is above `longest`."""
    factor = min(1.0, longest / max(height, width))
    return max(1, round(factor * height)), max(1, round(factor * width))
