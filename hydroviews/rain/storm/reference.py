"""Cover by falling drops by following them through the exposure, in float64: slow, to compare `rasterise` with.

Every drop is a disk that moves on its path in perspective; points of the disk, of the lens's opening and of the
exposure are sampled evenly (Sobol), and each falls into the pixel it hits. Only the drops' shape (a disk that faces
the camera) and an even speed through the exposure are shared with what is tested.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from hydroviews.rain.storm.drop_sizes import Cloud
from hydroviews.rain.storm.rasterise import NEAREST, Shutter
from hydroviews.scene.cameras import Camera


def cover(cloud: Cloud, camera: Camera, shutter: Shutter, depth: NDArray, samples: int = 2**14) -> NDArray[np.float64]:
    """Cover [H, W] in [0, 1] by drops in front of surfaces at `depth` [H, W] metres; the camera in metres.

    `samples`, a power of two, is the number of points each drop's path is followed with.
    """
    unit = qmc.Sobol(5, scramble=True, seed=0).random(samples)
    clear = np.ones((camera.height, camera.width))
    offsets = cloud.positions + cloud.velocities * shutter.time - camera.centre
    offsets -= cloud.periods[:, None] * np.floor(offsets / cloud.periods[:, None] + 0.5)
    near = np.linalg.norm(offsets, axis=1) <= cloud.periods / 2
    for i in np.flatnonzero(near & _perhaps_seen(cloud, offsets, camera, shutter)):
        path = offsets[i] + cloud.velocities[i] * shutter.exposure * unit[:, :1]
        clear *= 1 - np.minimum(_one_drop(path, cloud.diameters[i], camera, shutter, depth, unit[:, 1:]), 1)
    return np.asarray(1 - clear)


def _perhaps_seen(cloud: Cloud, offsets: NDArray, camera: Camera, shutter: Shutter) -> NDArray[np.bool_]:
    """Leaves out [N] what surely stays outside the picture: nothing else depends on it."""
    x, y, z = (offsets @ camera.rotation.T).T
    moved = np.linalg.norm(cloud.velocities, axis=1) * shutter.exposure
    slack = moved + cloud.diameters + shutter.aperture * (1 + (z + moved) / shutter.focus)
    deepest = z + moved
    beside = np.abs(x) - slack > deepest * camera.width / camera.fx
    above = np.abs(y) - slack > deepest * camera.height / camera.fy
    return np.asarray((deepest >= NEAREST) & ~beside & ~above)


def _one_drop(
    path: NDArray, diameter: float, camera: Camera, shutter: Shutter, depth: NDArray, unit: NDArray
) -> NDArray[np.float64]:
    """Mean cover [H, W] of one drop: `path` [S, 3] from the camera in the world's axes, `unit` [S, 4] in [0, 1)."""
    local = path @ camera.rotation.T
    in_front = local[:, 2] >= NEAREST
    if not in_front.any():
        return np.zeros(depth.shape)
    local, unit = local[in_front], unit[in_front]
    z = local[:, 2]
    focal = np.sqrt(camera.fx * camera.fy)
    blur = shutter.aperture * focal * np.abs(1 / z - 1 / shutter.focus)
    across = focal * diameter / z
    spot = _disk(unit[:, :2]) * across[:, None] + _disk(unit[:, 2:]) * blur[:, None]
    pixels = local[:, :2] / z[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy) + spot
    column, row = np.floor(pixels).astype(int).T
    seen = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    column, row, z, across = column[seen], row[seen], z[seen], across[seen]
    visible = z < depth[row, column]
    area = np.pi / 4 * across[visible] ** 2 / len(path)
    flat = np.bincount(row[visible] * camera.width + column[visible], area, minlength=depth.size)
    return flat.astype(np.float64).reshape(depth.shape)


def _disk(unit: NDArray) -> NDArray[np.float64]:
    """Even points in a disk of diameter 1 from even points in the unit square."""
    radius, angle = np.sqrt(unit[:, 0]) / 2, 2 * np.pi * unit[:, 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
