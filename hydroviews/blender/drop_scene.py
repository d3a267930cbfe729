"""Water drops on a lens, lit by a picture far behind them: the scene that `bake_drops` and `trace_drops` share."""

from collections.abc import Mapping

import bpy
import numpy as np
from numpy.typing import NDArray

from hydroviews.blender.cycles import empty_scene, place_camera
from hydroviews.scene.cameras import Camera

WATER = 1.333  # refractive index
DISTANCE = 100.0  # of the picture, in units of the lens's distance: nearly parallel light
FRAMES = 9.0  # the picture's plane is this many frames wide and high, the camera's own in the middle

Colour = tuple[float, float, float]


def lens_scene(
    water: Mapping[str, NDArray], camera: Camera, ambient: Colour, aperture: float, focus: str
) -> bpy.types.Scene:
    """Drops in front of a camera at the origin; all around is light of the colour `ambient`.

    What the camera sees beside the drops is left out: alpha is the drops' cover.

    Args:
        water: the fields of `WaterMesh`.
        camera: with OpenCV axes.
        ambient: linear light.
        aperture: radius in units of the lens's distance; 0 is a pinhole.
        focus: on the "scene", the picture, or on the "drops".
    """
    scene = empty_scene(seed=0)
    scene.cycles.max_bounces = scene.cycles.transmission_bounces = scene.cycles.glossy_bounces = 10
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0.0
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.film_transparent = True
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*ambient, 1.0)
    material = _water()
    for name, smooth in (("caps", True), ("bases", False)):
        _add_water(scene, name, water["vertices"], water[name], smooth, material)
    place_camera(scene, camera)
    _open_aperture(scene, aperture, DISTANCE if focus == "scene" else 1.0)
    return scene


def _add_water(
    scene: bpy.types.Scene, name: str, vertices: NDArray, triangles: NDArray, smooth: bool, material: bpy.types.Material
) -> None:
    used, corners = np.unique(triangles, return_inverse=True)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(used))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices[used], np.float32).ravel())
    mesh.loops.add(len(corners.ravel()))
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(corners, np.int32).ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(triangles), 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.polygons.foreach_set("use_smooth", np.full(len(triangles), smooth))
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def _open_aperture(scene: bpy.types.Scene, radius: float, distance: float) -> None:
    lens = scene.camera.data
    lens.dof.use_dof = radius > 0
    if radius > 0:
        lens.dof.focus_distance = distance
        # Rays that meet on the picture are farther apart at the camera than at the lens. Those that meet on the lens
        # part by the same angle, so that both are this wide.
        lens.dof.aperture_fstop = 1e-3 * lens.lens / (2 * radius / (1 - 1 / DISTANCE))


def _water() -> bpy.types.Material:
    material = bpy.data.materials.new("water")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    glass = tree.nodes.new("ShaderNodeBsdfGlass")
    glass.inputs["Roughness"].default_value = 0.0
    glass.inputs["IOR"].default_value = WATER
    tree.links.new(glass.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def add_ramp(scene: bpy.types.Scene, camera: Camera) -> None:
    """Light up the plane with (a, b, 1): its own coordinates, 0 to 1 over all its frames."""
    tree, place = _plane(scene, camera)
    _emit(tree, place)


def add_picture(scene: bpy.types.Scene, camera: Camera, picture: NDArray[np.float32]) -> None:
    """Light up the plane with a picture [H, W, 3] of linear light, mirrored beyond its borders."""
    height, width = picture.shape[:2]
    image = bpy.data.images.new("picture", width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = picture[::-1]  # Blender's rows go up
    image.pixels.foreach_set(pixels.ravel())
    tree, place = _plane(scene, camera)
    # From the plane's coordinates to the image's, whose second one goes up.
    across = tree.nodes.new("ShaderNodeVectorMath")
    across.operation = "MULTIPLY_ADD"
    middle = (FRAMES - 1) / 2
    across.inputs[1].default_value = (FRAMES, -FRAMES, 0)
    across.inputs[2].default_value = (-middle, 1 + middle, 0)
    tree.links.new(place, across.inputs[0])
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.extension, texture.interpolation = image, "MIRROR", "Linear"
    tree.links.new(across.outputs[0], texture.inputs["Vector"])
    _emit(tree, texture.outputs["Color"])


def _plane(scene: bpy.types.Scene, camera: Camera) -> tuple[bpy.types.NodeTree, bpy.types.NodeSocket]:
    """The distant plane; its material's nodes, and (a, b, 1) there."""
    size = np.array([camera.width, camera.height])
    margin = (FRAMES - 1) / 2 * size
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    low, high = ((corner - centre) / focal * DISTANCE for corner in (-margin, size + margin))
    mesh = bpy.data.meshes.new("picture plane")
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    mesh.from_pydata([(float(x), float(y), DISTANCE) for x, y in corners], [], [(0, 1, 2, 3)])
    plane = bpy.data.objects.new("picture plane", mesh)
    plane.visible_camera = False
    scene.collection.objects.link(plane)
    material = bpy.data.materials.new("picture")
    material.use_nodes = True
    material.cycles.emission_sampling = "NONE"
    mesh.materials.append(material)
    tree = material.node_tree
    tree.nodes.clear()
    scale = tree.nodes.new("ShaderNodeVectorMath")
    scale.operation = "MULTIPLY_ADD"
    scale.inputs[1].default_value = (*(1 / (high - low)), 0)
    scale.inputs[2].default_value = (*(-low / (high - low)), 1)
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], scale.inputs[0])
    return tree, scale.outputs[0]


def _emit(tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket) -> None:
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
