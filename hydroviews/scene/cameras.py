"""Pinhole cameras: OpenCV axes (x right, y down, z forward), pixel centres at +0.5."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Camera:
    """One view's intrinsics in pixels and its pose.

    The top-left corner of the image is (0, 0), the centre of its first pixel (0.5, 0.5), as in COLMAP.

    Raises:
        ValueError: a pose that is not [4, 4].
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: NDArray[np.float64]  # [4, 4], rigid

    def __post_init__(self) -> None:
        pose = np.asarray(self.world_to_camera, np.float64)
        if pose.shape != (4, 4):
            raise ValueError(f"world_to_camera has shape {pose.shape}, expected (4, 4)")
        object.__setattr__(self, "world_to_camera", pose)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Intrinsic matrix [3, 3]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def rotation(self) -> NDArray[np.float64]:
        """World-to-camera rotation [3, 3]."""
        return self.world_to_camera[:3, :3]

    @property
    def centre(self) -> NDArray[np.float64]:
        """Position in the world [3]."""
        return -self.rotation.T @ self.world_to_camera[:3, 3]

    @property
    def slopes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x / z of each column [W] and y / z of each row [H], in the middle of pixels."""
        across = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        down = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        return across, down

    def resized(self, width: int, height: int) -> "Camera":
        """The same camera at another image size: the exact factor along each axis."""
        x, y = width / self.width, height / self.height
        return replace(self, width=width, height=height, fx=self.fx * x, fy=self.fy * y, cx=self.cx * x, cy=self.cy * y)

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels [N, 2] and depths [N] of world points [N, 3]; pixels mean nothing where the depth is not positive."""
        local = np.asarray(points, np.float64) @ self.rotation.T + self.world_to_camera[:3, 3]
        depth = local[:, 2]
        safe = np.where(depth > 0, depth, 1.0)
        return local[:, :2] / safe[:, None] * (self.fx, self.fy) + (self.cx, self.cy), depth


def fitted_size(width: int, height: int, long_side: int | None) -> tuple[int, int]:
    """The size whose longer side is `long_side`, the other one rounded half up; never larger than the given size."""
    longest = max(width, height)
    if long_side is None or long_side >= longest:
        return width, height
    factor = long_side / longest
    return max(1, int(width * factor + 0.5)), max(1, int(height * factor + 0.5))


def same_shape(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether one (width, height) is the other, or the other scaled and rounded up or down to whole pixels."""
    if size[0] == other[0] or size[1] == other[1]:
        return size == other
    (width, height), (larger_width, larger_height) = sorted((size, other))
    # Rounded widths and heights each are less than one pixel from the exact ones.
    lowest, highest = (width - 1) / larger_width, (width + 1) / larger_width
    return (height + 1) / larger_height > lowest and (height - 1) / larger_height < highest
