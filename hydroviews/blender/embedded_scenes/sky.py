"""What surrounds a scene: a sky with clouds as an environment image, and the sun."""

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from hydroviews.blender.embedded_scenes.pieces import Sky
from hydroviews.blender.embedded_scenes.textures import SIZE, noise

HEIGHT = 512  # rows of the environment image, twice as many columns
SUN_WIDTH = np.radians(2.5)  # wider than the real one, so that few samples draw soft shadow edges


def add_sky(scene: bpy.types.Scene, sky: Sky, rng: np.random.Generator) -> None:
    """Give the scene a world and, if it is up, a sun."""
    image = bpy.data.images.new("sky", 2 * HEIGHT, HEIGHT, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((HEIGHT, 2 * HEIGHT, 4), np.float32)
    pixels[..., :3] = _radiance(sky, _directions(), rng)
    image.pixels.foreach_set(pixels.ravel())
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    tree = scene.world.node_tree
    environment = tree.nodes.new("ShaderNodeTexEnvironment")
    environment.image = image
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    tree.links.new(environment.outputs["Color"], background.inputs["Color"])
    if sky.sun_strength > 0:
        _add_sun(scene, sky)


def _add_sun(scene: bpy.types.Scene, sky: Sky) -> None:
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.angle, lamp.color = sky.sun_strength, SUN_WIDTH, sky.sun_colour
    sun = bpy.data.objects.new("sun", lamp)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector(_sun(sky).tolist()).to_track_quat("Z", "Y")
    scene.collection.objects.link(sun)


def _sun(sky: Sky) -> NDArray[np.float64]:
    direction = np.array(sky.sun_direction, float)
    return direction / np.linalg.norm(direction)


def _directions() -> NDArray[np.float64]:
    """Unit vectors [HEIGHT, 2 HEIGHT, 3] of an equirectangular image, bottom row first as Blender keeps it."""
    elevation = ((np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5) * np.pi
    azimuth = (0.5 - (np.arange(2 * HEIGHT) + 0.5) / (2 * HEIGHT)) * 2 * np.pi
    elevation, azimuth = np.meshgrid(elevation, azimuth, indexing="ij")
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def _radiance(sky: Sky, directions: NDArray, rng: np.random.Generator) -> NDArray[np.float64]:
    """Linear RGB of the sky in each direction [..., 3], without the sun itself."""
    up = directions[..., 2:]
    height = np.clip(up, 0, 1)
    radiance = np.array(sky.horizon) + (np.array(sky.zenith) - sky.horizon) * height**0.55
    toward_sun = np.clip(directions @ _sun(sky), 0, 1)[..., None]
    radiance = radiance + np.array(sky.glow) * toward_sun**12
    cover = _clouds(directions, rng)[..., None]
    cloud = np.array(sky.clouds) * (0.72 + 0.28 * toward_sun)
    radiance = radiance + (cloud - radiance) * cover
    below = np.clip(-up * 12, 0, 1)
    return radiance + (np.array(sky.ground) - radiance) * below


def _clouds(directions: NDArray, rng: np.random.Generator) -> NDArray[np.float64]:
    """Cover in [0, 1]: noise on a plane overhead, so that clouds shrink towards the horizon, where they fade."""
    pattern = noise(rng, 2.1, 3)
    up = np.maximum(directions[..., 2], 0.0)
    place = directions[..., :2] / (up + 0.25)[..., None] * SIZE * 0.3
    values = map_coordinates(pattern, [place[..., 1], place[..., 0]], order=1, mode="grid-wrap")
    return np.clip((values - 0.5) / 0.3, 0, 1) * np.clip(up / 0.08, 0, 1) * 0.95
