"""Where fields live: unbounded scenes contracted into a ball, forward-facing ones in normalised device coordinates.

A space takes world rays in, says which positions along them are worth a sample, and maps points to the unit cube that
fields are defined on.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splatting.strategies.initialisation import scene_extent
from baselines.volumetric.rays.rays import NEAREST, CameraArrays, WorldRays, depth_range
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points

KINDS = ("auto", "contracted", "ndc")
BEYOND = 2.0  # times the farthest points: where contracted rays end, but for what is infinitely far away
STEEPEST = 0.2  # of a forward-facing scene's rays: smallest cosine with the mean viewing direction


@dataclass(frozen=True)
class Rays:
    """R rays in a space's coordinates; a point at t is origin + t direction."""

    origins: Tensor  # [R, 3]
    directions: Tensor  # [R, 3]
    viewing: Tensor  # [R, 3], world directions of length one

    def points(self, t: Tensor) -> Tensor:
        """Points [R, S, 3] at t [R, S]."""
        return self.origins[:, None] + t[..., None] * self.directions[:, None]

    def part(self, start: int, end: int) -> "Rays":
        """Some of the rays."""
        return Rays(self.origins[start:end], self.directions[start:end], self.viewing[start:end])


class Space(Protocol):
    """A scene's coordinates."""

    @property
    def horizon(self) -> float:
        """The t of what is infinitely far away."""

    def from_world(self, rays: WorldRays, device: torch.device) -> Rays:
        """World rays in this space's coordinates, in float32."""

    def s_to_t(self, s: Tensor) -> Tensor:
        """t for s in [0, 1], the coordinate that samples are spread over."""

    def to_unit_cube(self, points: Tensor) -> Tensor:
        """Points [..., 3] of the space in the unit cube."""

    def settings(self) -> dict[str, Any]:
        """All that makes the space, for JSON."""


def contract(points: Tensor) -> Tensor:
    """Points [..., 3] moved into the ball of radius 2; those in the unit ball stay (Mip-NeRF 360, equation 10)."""
    norms = points.norm(dim=-1, keepdim=True).clamp_min(1)
    return points * ((2 - 1 / norms) / norms)


def expand(points: Tensor) -> Tensor:
    """The inverse of `contract` on the open ball of radius 2."""
    norms = points.norm(dim=-1, keepdim=True).clamp_min(1)
    return points / ((2 - norms) * norms)


@dataclass(frozen=True)
class Contracted:
    """Cameras in the unit ball, everything else contracted around it; samples are spread evenly over log t."""

    kind: ClassVar[str] = "contracted"
    horizon: ClassVar[float] = 1e6
    middle: tuple[float, ...]  # world position of the origin
    radius: float  # world units a unit
    near: float  # in units
    far: float

    def from_world(self, rays: WorldRays, device: torch.device) -> Rays:
        """See Space."""
        origins, directions = (rays.origins - np.array(self.middle)) / self.radius, rays.directions
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        return _rays(origins, directions, directions / lengths, device)

    def s_to_t(self, s: Tensor) -> Tensor:
        """See Space: near (far / near)^s."""
        return self.near * (self.far / self.near) ** s

    def to_unit_cube(self, points: Tensor) -> Tensor:
        """See Space."""
        return contract(points) / 4 + 0.5

    def settings(self) -> dict[str, Any]:
        """See Space."""
        return {"kind": self.kind, **asdict(self)}


@dataclass(frozen=True)
class NDC:
    """The frustum of a mean camera from its near plane to infinity as a cube (NeRF, appendix C)."""

    kind: ClassVar[str] = "ndc"
    horizon: ClassVar[float] = 1.0
    pose: tuple[tuple[float, ...], ...]  # world to the mean camera [4, 4]
    slopes: tuple[float, float]  # x / z and y / z at the sides of the frustum
    near: float  # world units

    def from_world(self, rays: WorldRays, device: torch.device) -> Rays:
        """See Space; t runs from 0 at the near plane to 1 at infinity.

        Raises:
            InputError: a ray that does not point forwards.
        """
        pose = np.array(self.pose)
        origins, directions = rays.origins @ pose[:3, :3].T + pose[:3, 3], rays.directions @ pose[:3, :3].T
        if (directions[:, 2] <= 0).any():
            raise InputError(
                "normalised device coordinates: a camera looks backwards",
                expected="cameras that all look the same way",
                fix="use the contracted space for scenes that are seen from all sides",
            )
        origins = origins + (self.near - origins[:, 2:]) / directions[:, 2:] * directions
        start, end = origins[:, :2] / origins[:, 2:], directions[:, :2] / directions[:, 2:]
        zeros = np.zeros((len(origins), 1))
        moved = np.concatenate([start / self.slopes, zeros - 1], axis=1)
        along = np.concatenate([(end - start) / self.slopes, zeros + 2], axis=1)
        lengths = np.linalg.norm(rays.directions, axis=1, keepdims=True)
        return _rays(moved, along, rays.directions / lengths, device)

    def s_to_t(self, s: Tensor) -> Tensor:
        """See Space."""
        return s

    def to_unit_cube(self, points: Tensor) -> Tensor:
        """See Space."""
        return points / 2 + 0.5

    def settings(self) -> dict[str, Any]:
        """See Space."""
        return {"kind": self.kind, **asdict(self)}


def _rays(origins: NDArray, directions: NDArray, viewing: NDArray, device: torch.device) -> Rays:
    return Rays(*(torch.from_numpy(a.astype(np.float32)).to(device) for a in (origins, directions, viewing)))


def choose_space(cameras: Sequence[Camera], points: Points, kind: str = "auto") -> Space:
    """The space for a scene.

    Args:
        cameras: of the training views, one or more.
        points: of the scene.
        kind: contracted, ndc, or auto: ndc where all rays point roughly the same way.

    Raises:
        InputError: no cameras, an unknown kind, or ndc for cameras that do not look the same way.
    """
    if not cameras:
        raise InputError("no training views", expected="at least one")
    if kind not in KINDS:
        raise InputError(f"space {kind}: unknown", expected=", ".join(KINDS))
    middle, extent = scene_extent(cameras, points.positions)
    near, far = depth_range(cameras, points, extent)
    pose = mean_pose(cameras)
    steepest = min(_steepness(camera, pose) for camera in cameras)
    if kind == "contracted" or (kind == "auto" and steepest < STEEPEST):
        return Contracted(tuple(map(float, middle)), extent, near / extent, max(far, 2 * near) * BEYOND / extent)
    if steepest <= 0:
        raise InputError("space ndc: cameras look every way", expected="a forward-facing capture", fix="contracted")
    mean = replace(cameras[0], world_to_camera=pose)
    return _forward(cameras, pose, depth_range([mean], points, extent)[0])


def space_from(settings: dict[str, Any]) -> Space:
    """The space whose `settings` are given."""
    if settings["kind"] == Contracted.kind:
        values = {name: value for name, value in settings.items() if name != "kind"}
        return Contracted(**{**values, "middle": tuple(settings["middle"])})
    return NDC(tuple(map(tuple, settings["pose"])), tuple(settings["slopes"]), settings["near"])


def mean_pose(cameras: Sequence[Camera]) -> NDArray[np.float64]:
    """World to the mean camera [4, 4]: mean position, mean viewing direction and mean down direction."""
    forward = np.mean([camera.rotation[2] for camera in cameras], axis=0)
    down = np.mean([camera.rotation[1] for camera in cameras], axis=0)
    forward = forward / max(float(np.linalg.norm(forward)), 1e-12)
    right = np.cross(down, forward)
    right = right / max(float(np.linalg.norm(right)), 1e-12)
    pose = np.eye(4)
    pose[:3, :3] = [right, np.cross(forward, right), forward]
    pose[:3, 3] = -pose[:3, :3] @ np.mean([camera.centre for camera in cameras], axis=0)
    return pose


def _steepness(camera: Camera, pose: NDArray[np.float64]) -> float:
    """Smallest cosine between a corner's ray and the mean viewing direction."""
    directions = _corner_rays(camera).directions
    return float((directions @ pose[2, :3] / np.linalg.norm(directions, axis=1)).min())


def _corner_rays(camera: Camera) -> WorldRays:
    columns, rows = np.array([[0, 0], [camera.width, 0], [0, camera.height], [camera.width, camera.height]]).T
    return CameraArrays([camera]).rays(np.zeros(4, np.int64), columns, rows)


def _forward(cameras: Sequence[Camera], pose: NDArray[np.float64], near: float) -> NDC:
    """The frustum that holds every ray of the cameras from the near plane on, which lies before all of them."""
    ahead = max(float((pose[2, :3] @ camera.centre) + pose[2, 3]) for camera in cameras)
    plane = max(near, ahead + NEAREST * near)
    slopes = np.zeros(2)
    for camera in cameras:
        rays = _corner_rays(camera)
        origins, directions = rays.origins @ pose[:3, :3].T + pose[:3, 3], rays.directions @ pose[:3, :3].T
        at_plane = origins + (plane - origins[:, 2:]) / directions[:, 2:] * directions
        for points in (at_plane, directions):
            slopes = np.maximum(slopes, np.abs(points[:, :2] / points[:, 2:]).max(axis=0))
    return NDC(tuple(map(tuple, pose.tolist())), (float(slopes[0]), float(slopes[1])), plane)
