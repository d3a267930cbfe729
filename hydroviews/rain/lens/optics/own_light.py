"""Light of a drop's own: each shows a bright and a dark part of the surroundings, hardly the scene behind it.

A drop is a short lens that turns its surroundings upside down. Which part of them a light path reaches depends on
how far the drop turns it, and not on where the drop sits: so all drops of a pane look alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.lens.patterns.fields import smooth_field
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import to_linear
from hydroviews.scene.seeds import generator

Plane = NDArray[np.float32]
ROUND = 0.25  # tangent: radius of the dark part, around what is turned downwards by as much; makes crescents
GLARE = 2.0  # radiance of the bright part over what a photograph records of it, where it is spread by defocus
SHARP = 0.3  # share of the way across a tilted pane that is in focus
DISKS = (0.0, 0.25, 0.5, 1.0)  # shares of the largest defocus disk at which a tilted pane is blurred


@dataclass(frozen=True)
class SkyEdge:
    """The edge at which the bright part of the surroundings begins."""

    towards: tuple[float, float]  # unit vector in the picture, right and down
    edge: float  # tangent
    softness: float  # tangent
    focal: tuple[float, float]  # pixels

    @classmethod
    def of(cls, pattern: WindowPattern, camera: Camera) -> "SkyEdge":
        """The edge of a pattern in front of a camera."""
        towards = (float(np.sin(pattern.up)), float(-np.cos(pattern.up)))
        return cls(towards, pattern.edge, pattern.softness, (camera.fx, camera.fy))

    def share(self, pixel: NDArray[np.int64], place: NDArray, width: int) -> NDArray[np.float64]:
        """The share of the light of each path [N] that is the bright part's.

        Args:
            pixel: [N], flat indices of lens pixels.
            place: [N, 2], where the paths end, in pixels.
            width: of the lens in pixels.
        """
        turned = place - np.column_stack([pixel % width + 0.5, pixel // width + 0.5])
        tangents, up = turned / self.focal, np.array(self.towards)
        tangent = np.linalg.norm(tangents + ROUND * up, axis=1) - ROUND
        tangent[tangents @ up < -ROUND] = -np.inf  # what is turned down that far is beyond the dark part, and dark
        t = np.clip((tangent - self.edge) / self.softness + 0.5, 0, 1)
        return np.asarray(t * t * (3 - 2 * t))

    def plane(self, traced: dict[str, NDArray]) -> Plane:
        """The bright part's share of the light of each lens pixel, [H, W]; paths that end nowhere are dark."""
        height, width = traced["cover"].shape
        light = traced["throughput"] * self.share(traced["pixel"], traced["place"], width)
        return np.bincount(traced["pixel"], light, minlength=height * width).reshape(height, width).astype(np.float32)


class OwnLight:
    """The own light of a pane's drops: bright and dark, uneven over the pane."""

    def __init__(self, pattern: WindowPattern, width: int, height: int) -> None:
        side = np.sqrt(width * height)
        field = smooth_field(generator(pattern.seed, "own light"), (width / side, height / side), (3, 8))
        lit = cv2.resize((1 - pattern.uneven * field).astype(np.float32), (width, height))
        bright, dark = to_linear(np.array([pattern.bright, pattern.dark], np.float32))
        self._bright = lit * (bright * np.float32(GLARE if pattern.tilt > 0 else 1.0))
        self._dark = lit * dark

    def radiance(self, mask: Plane, sky: Plane) -> Plane:
        """Linear light [H, W, 3] of drops that cover [H, W], of which the share `sky` [H, W] shows the bright part."""
        sky = np.minimum(sky, mask)
        grey = self._bright * sky + self._dark * (mask - sky)
        return np.repeat(grey[..., None], 3, axis=-1)


def tilted(planes: Sequence[Plane], pattern: WindowPattern) -> list[Plane]:
    """Planes [H, W] or [H, W, C] as a tilted pane shows them: sharp on one side, blurred by a disk on the other.

    The near SHARP of the pane is sharp, and from there on the disk grows linearly. Pictures blurred by a few disks are
    mixed, pixel by pixel.
    """
    if pattern.tilt == 0:
        return list(planes)
    height, width = planes[0].shape[:2]
    largest = pattern.tilt * float(np.sqrt(width * height))
    across = ((np.arange(width) + 0.5) / width - 0.5) * np.cos(pattern.tilt_direction)
    along = ((np.arange(height) + 0.5) / height - 0.5) * np.sin(pattern.tilt_direction)
    reach = np.abs(across).max() + np.abs(along).max()
    far = ((along[:, None] + across) / reach + 1) / 2  # 0 at the near corner, 1 at the far one
    far = np.maximum(far - SHARP, 0) / (1 - SHARP)
    weights = [np.interp(far, DISKS, row).astype(np.float32) for row in np.eye(len(DISKS))]
    mixed = []
    for plane in planes:
        blurred = [defocus(plane, share * largest) for share in DISKS]
        shape = (height, width, *(1,) * (plane.ndim - 2))
        parts = [weight.reshape(shape) * blur for weight, blur in zip(weights, blurred, strict=True)]
        mixed.append(np.asarray(sum(parts), np.float32))
    return mixed
