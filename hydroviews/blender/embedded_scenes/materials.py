"""Materials: image textures wrapped around objects by box projection, in metres."""

from collections.abc import Iterable

import bpy
import numpy as np
from numpy.typing import NDArray

from hydroviews.blender.embedded_scenes.looks import LOOKS, Look
from hydroviews.blender.embedded_scenes.textures import SIZE


def make_materials(rng: np.random.Generator, names: Iterable[str]) -> dict[str, bpy.types.Material]:
    """The materials of these looks, by name; what else is made does not change a texture."""
    wanted = set(names)
    children = dict(zip(LOOKS, rng.spawn(len(LOOKS)), strict=True))
    return {name: _material(name, look, children[name]) for name, look in LOOKS.items() if name in wanted}


def _material(name: str, look: Look, rng: np.random.Generator) -> bpy.types.Material:
    texture = look.pattern(rng, np.array(look.dark), np.array(look.light))
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    scale = tree.nodes.new("ShaderNodeVectorMath")
    scale.operation = "SCALE"
    scale.inputs["Scale"].default_value = 1 / look.metres
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], scale.inputs[0])
    colour = _box_projected(tree, scale.outputs[0], _image(f"{name} colour", texture.colour, "sRGB"))
    height = _box_projected(tree, scale.outputs[0], _image(f"{name} height", texture.height[..., None], "Non-Color"))
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = look.bump
    bump.inputs["Distance"].default_value = 0.03
    tree.links.new(height, bump.inputs["Height"])
    surface = _surface(tree, look)
    tree.links.new(colour, surface.inputs[0])
    if look.emission:  # lamps stand beside what glows, so that few samples find all light
        material.cycles.emission_sampling = "NONE"
    else:
        _add_bump(tree, surface, height, look.bump)
    tree.links.new(surface.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def _add_bump(tree: bpy.types.NodeTree, surface: bpy.types.Node, height: bpy.types.NodeSocket, strength: float) -> None:
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value = strength
    bump.inputs["Distance"].default_value = 0.03
    tree.links.new(height, bump.inputs["Height"])
    tree.links.new(bump.outputs[0], surface.inputs["Normal"])


def _surface(tree: bpy.types.NodeTree, look: Look) -> bpy.types.Node:
    if look.emission:
        glow = tree.nodes.new("ShaderNodeEmission")
        glow.inputs["Strength"].default_value = look.emission
        return glow
    if look.roughness >= 0.6:  # the plain diffuse surface costs a fraction of the general one
        return tree.nodes.new("ShaderNodeBsdfDiffuse")
    surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Roughness"].default_value = look.roughness
    surface.inputs["Metallic"].default_value = look.metallic
    return surface


def _box_projected(
    tree: bpy.types.NodeTree, place: bpy.types.NodeSocket, image: bpy.types.Image
) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    node.projection = "BOX"
    node.projection_blend = 0.1
    tree.links.new(place, node.inputs["Vector"])
    return node.outputs["Color"]


def _image(name: str, values: NDArray, colour_space: str) -> bpy.types.Image:
    image = bpy.data.images.new(name, SIZE, SIZE)
    image.colorspace_settings.name = colour_space
    pixels = np.ones((SIZE, SIZE, 4), np.float32)
    pixels[..., :3] = values[::-1]  # Blender's rows go up
    image.pixels.foreach_set(pixels.ravel())
    return image
