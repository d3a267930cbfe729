"""Lamps in the world: how they light what is near them, and the air around them.

A lamp is a small ball that shines alike to all sides. Its light falls off with the square of the distance; what hides
what from it is not known, so nothing throws shadows. Distances are metres.
"""

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.cameras import Camera

RADIUS = 0.04  # metres, of a lamp


def rays(camera: Camera) -> NDArray[np.float64]:
    """Unit vectors [H, W, 3] in the world, from the camera's centre through each pixel's."""
    local = np.stack([*np.meshgrid(*camera.slopes), np.ones((camera.height, camera.width))], axis=-1)
    return local / np.linalg.norm(local, axis=-1, keepdims=True) @ camera.rotation


def along_and_beside(lamp: NDArray, camera: Camera, ways: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where along each ray [H, W, 3] it is nearest to a lamp [3], and how far beside it the lamp is: [H, W] each."""
    to_lamp = lamp - camera.centre
    along = ways @ to_lamp
    return along, np.linalg.norm(to_lamp - along[..., None] * ways, axis=-1)


def illumination(along: NDArray, beside: NDArray, distance: NDArray) -> NDArray[np.float64]:
    """Light [H, W] that falls from a lamp on what lies at `distance` [H, W]: 1 at one metre from the lamp."""
    return 1 / ((distance - along) ** 2 + beside**2 + RADIUS**2)


def air_glow(along: NDArray, beside: NDArray, distance: NDArray) -> NDArray[np.float64]:
    """The integral [H, W] along each ray, from the camera to `distance` [H, W], of a lamp's light: 1/m.

    Light that is scattered once, without loss on its way (compare Sun et al. 2005), has the closed form
    (atan((d - s) / h) + atan(s / h)) / h for a lamp h metres beside the ray at s metres along it. Times the
    extinction, and the quarter of a scattered light that goes each way, it is the light that the air shows.
    """
    off = np.hypot(beside, RADIUS)
    return (np.arctan((distance - along) / off) + np.arctan(along / off)) / off


def ball(along: NDArray, beside: NDArray, distance: NDArray, camera: Camera) -> NDArray[np.float64]:
    """Cover [H, W] of each pixel by the lamp itself, where nothing is before it."""
    pixel = np.maximum(along, RADIUS) / np.sqrt(camera.fx * camera.fy)
    cover = np.clip((RADIUS - beside) / pixel + 0.5, 0, 1) * np.minimum(1, (2 * RADIUS / pixel) ** 2)
    return np.where((along > 0) & (along < distance), cover, 0)
