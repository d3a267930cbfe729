"""A trained scene as a browser shows it: moved to the origin, scaled, colours without view dependence.

Browsers draw in float32 and hold covariances in half precision, so that a scene far from the origin, tiny or huge
would fall apart. Everything that is shown is moved and scaled alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.splatting.gaussians import Gaussians
from baselines.training.images import evenly_spread
from hydroviews.scene.cameras import Camera

SIZE = 10.0  # median distance from the cameras' centre of what is shown, in the browser's units
LARGEST = 200.0  # standard deviation in these units: its square still is a half-precision number
DIRECTIONS = 16  # cameras over which colours are averaged
FRUSTUM, LONGEST = 0.4, 1.0  # length of a frustum over the distance to the next camera, and at most


@dataclass(frozen=True)
class Normalisation:
    """Where the browser's scene lies in the world: shown = (world - centre) * scale."""

    centre: NDArray[np.float64]  # [3]
    scale: float
    up: NDArray[np.float64]  # [3], of length one

    def place(self, positions: ArrayLike) -> NDArray[np.float64]:
        """World positions [..., 3] in the browser."""
        return (np.asarray(positions, np.float64) - self.centre) * self.scale


@dataclass(frozen=True)
class Splats:
    """N Gaussians under the names that viser gives their parameters."""

    centers: NDArray[np.float32]  # [N, 3]
    covariances: NDArray[np.float32]  # [N, 3, 3]
    rgbs: NDArray[np.float32]  # [N, 3] in [0, 1]
    opacities: NDArray[np.float32]  # [N, 1] in [0, 1]


def normalise_scene(cameras: Sequence[Camera], gaussians: Gaussians | None) -> Normalisation:
    """The normalisation for a scene that was seen by these cameras, one or more."""
    centres = np.array([camera.centre for camera in cameras])
    centre = centres.mean(axis=0)
    away = centres - centre
    if gaussians is not None and len(gaussians):
        away = gaussians.means + (gaussians.origin - centre)
    distance = float(np.median(np.linalg.norm(away, axis=1)))
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    if np.linalg.norm(up) < 1e-6:  # they are turned every way
        up = -cameras[0].rotation[1]
    return Normalisation(centre, SIZE / distance if distance > 0 else 1.0, up / np.linalg.norm(up))


def normalise_splats(gaussians: Gaussians, cameras: Sequence[Camera], normalisation: Normalisation) -> Splats:
    """The Gaussians moved and scaled, in colours as the cameras see them on average."""
    import torch

    from baselines.splatting.backends.torch_rasterizer import rotations

    deviations = np.minimum(np.exp(gaussians.log_scales.astype(np.float64)) * normalisation.scale, LARGEST)
    factors = rotations(torch.from_numpy(gaussians.quaternions)).numpy() * deviations[:, None, :]
    return Splats(
        centers=((gaussians.means + (gaussians.origin - normalisation.centre)) * normalisation.scale).astype(
            np.float32
        ),
        covariances=(factors @ factors.transpose(0, 2, 1)).astype(np.float32),
        rgbs=_mean_colours(gaussians, cameras),
        opacities=torch.from_numpy(gaussians.opacity_logits).sigmoid().numpy()[:, None],
    )


def _mean_colours(gaussians: Gaussians, cameras: Sequence[Camera]) -> NDArray[np.float32]:
    """Colours [N, 3] averaged over the directions from cameras spread evenly over the list."""
    import torch

    from baselines.splatting.backends.torch_rasterizer import basis

    chosen = evenly_spread(len(cameras), DIRECTIONS)
    total = np.zeros((len(gaussians), 3))
    for index in chosen:
        directions = gaussians.means - (cameras[index].centre - gaussians.origin)
        directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
        values = basis(gaussians.sh_degree, torch.from_numpy(directions)).numpy()
        total += np.clip(np.einsum("nk,nkc->nc", values, gaussians.sh) + 0.5, 0, 1)
    return (total / len(chosen)).astype(np.float32)


def pose(camera: Camera, normalisation: Normalisation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Camera-to-world quaternion (w, x, y, z) and position in the browser."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(camera.rotation.T).as_quat()
    return np.roll(quaternion, 1), normalisation.place(camera.centre)


def vertical_fov(camera: Camera) -> float:
    """Angle between the top and the bottom of the image, radians, as if its axis went through the middle."""
    return 2 * math.atan(camera.height / (2 * camera.fy))


def window_fov(camera: Camera, aspect: float) -> float:
    """The vertical angle, radians, at which a window of this width over height shows the whole image."""
    half_height, half_width = camera.height / (2 * camera.fy), camera.width / (2 * camera.fx)
    return 2 * math.atan(max(half_height, half_width / aspect))


def frustum_length(cameras: Sequence[Camera], normalisation: Normalisation) -> float:
    """How long to draw frustums, so that neighbours rarely touch; in the browser's units."""
    from scipy.spatial import KDTree

    centres = normalisation.place([camera.centre for camera in cameras])
    if len(centres) < 2:
        return LONGEST
    typical = float(np.median(KDTree(centres).query(centres, k=2)[0][:, 1]))
    return min(FRUSTUM * typical, LONGEST) if typical > 0 else LONGEST
