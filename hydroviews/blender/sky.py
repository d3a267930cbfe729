"""Daylight: a sky with clouds as an environment image, and the sun."""

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from hydroviews.blender.textures import SIZE, noise

HEIGHT = 512  # rows of the environment image, twice as many columns
SUN_DIRECTION = np.array([0.55, -0.35, 0.76]) / np.linalg.norm([0.55, -0.35, 0.76])
SUN_STRENGTH = 4.6  # W/m^2 facing the sun; the sky's radiance is about 0.3 to 1.2 W/m^2/sr
SUN_WIDTH = np.radians(2.5)  # wider than the real one, so that few samples draw soft shadow edges
ZENITH, HORIZON, GROUND = (0.22, 0.45, 0.95), (0.8, 0.92, 1.08), (0.34, 0.32, 0.28)  # linear light


def add_sky(scene: bpy.types.Scene, rng: np.random.Generator) -> None:
    """Give the scene a world and a sun."""
    image = bpy.data.images.new("sky", 2 * HEIGHT, HEIGHT, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((HEIGHT, 2 * HEIGHT, 4), np.float32)
    pixels[..., :3] = _radiance(_directions(), rng)
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    tree = scene.world.node_tree
    environment = tree.nodes.new("ShaderNodeTexEnvironment")
    environment.image = image
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    tree.links.new(environment.outputs["Color"], background.inputs["Color"])
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.angle, lamp.color = SUN_STRENGTH, SUN_WIDTH, (1.0, 0.93, 0.82)
    sun = bpy.data.objects.new("sun", lamp)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector(SUN_DIRECTION.tolist()).to_track_quat("Z", "Y")
    scene.collection.objects.link(sun)


def _directions() -> NDArray[np.float64]:
    """Unit vectors [HEIGHT, 2 HEIGHT, 3] of an equirectangular image, bottom row first as Blender keeps it."""
    elevation = ((np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5) * np.pi
    azimuth = (0.5 - (np.arange(2 * HEIGHT) + 0.5) / (2 * HEIGHT)) * 2 * np.pi
    elevation, azimuth = np.meshgrid(elevation, azimuth, indexing="ij")
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def _radiance(directions: NDArray, rng: np.random.Generator) -> NDArray[np.float64]:
    """Linear RGB of the sky in each direction [..., 3], without the sun itself."""
    up = directions[..., 2:]
    height = np.clip(up, 0, 1)
    sky = np.array(HORIZON) + (np.array(ZENITH) - HORIZON) * height**0.55
    toward_sun = np.clip(directions @ SUN_DIRECTION, 0, 1)[..., None]
    sky = sky + np.array([0.9, 0.75, 0.5]) * 0.35 * toward_sun**12
    cover = _clouds(directions, rng)[..., None]
    cloud = np.array([1.12, 1.12, 1.14]) * (0.72 + 0.28 * toward_sun)
    sky = sky + (cloud - sky) * cover
    below = np.clip(-up * 12, 0, 1)
    return sky + (np.array(GROUND) - sky) * below


def _clouds(directions: NDArray, rng: np.random.Generator) -> NDArray[np.float64]:
    """Cover in [0, 1]: noise on a plane overhead, so that clouds shrink towards the horizon, where they fade."""
    pattern = noise(rng, 2.1, 3)
    up = np.maximum(directions[..., 2], 0.0)
    place = directions[..., :2] / (up + 0.25)[..., None] * SIZE * 0.3
    values = map_coordinates(pattern, [place[..., 1], place[..., 0]], order=1, mode="grid-wrap")
    return np.clip((values - 0.5) / 0.3, 0, 1) * np.clip(up / 0.08, 0, 1) * 0.95
