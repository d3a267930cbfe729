"""The courtyard's materials: image textures wrapped around objects by box projection, in metres."""

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from hydroviews.blender import textures
from hydroviews.blender.textures import SIZE, Pattern

Colour = tuple[float, float, float]  # sRGB-encoded, [0, 1]


@dataclass(frozen=True)
class Look:
    """How a surface looks."""

    pattern: Pattern
    dark: Colour
    light: Colour
    metres: float  # size of one period of the pattern
    bump: float = 0.6
    roughness: float = 0.9  # below 0.6 the surface gets a glossy coat
    metallic: float = 0.0


LOOKS = {
    "cobbles": Look(textures.stones(70), (0.46, 0.42, 0.38), (0.78, 0.72, 0.63), 3.0, bump=0.9),
    "paving": Look(textures.bricks(6, 3, 0.04), (0.62, 0.53, 0.42), (0.86, 0.78, 0.65), 2.4),
    "grass": Look(textures.stones(900, 0.5), (0.22, 0.36, 0.1), (0.55, 0.66, 0.25), 4.0, bump=0.9),
    "hill": Look(textures.rough(1.5), (0.25, 0.38, 0.14), (0.6, 0.6, 0.32), 20.0),
    "red brick": Look(textures.bricks(10, 4), (0.5, 0.2, 0.13), (0.78, 0.42, 0.3), 1.6, bump=0.8),
    "pale brick": Look(textures.bricks(8, 4), (0.7, 0.6, 0.44), (0.92, 0.85, 0.7), 2.0, bump=0.8),
    "ochre plaster": Look(textures.rough(), (0.78, 0.58, 0.3), (0.95, 0.8, 0.5), 3.0),
    "blue plaster": Look(textures.rough(), (0.4, 0.56, 0.68), (0.66, 0.78, 0.84), 3.0),
    "rose plaster": Look(textures.rough(), (0.76, 0.46, 0.4), (0.93, 0.7, 0.62), 3.0),
    "field stone": Look(textures.stones(60, 0.1, 0.5), (0.45, 0.43, 0.4), (0.82, 0.78, 0.7), 2.6, bump=0.9),
    "stone": Look(textures.rough(1.4), (0.5, 0.49, 0.47), (0.86, 0.84, 0.78), 1.6, bump=0.7),
    "red roof": Look(textures.shingles(8, 8), (0.52, 0.2, 0.12), (0.86, 0.46, 0.28), 1.8, bump=0.9),
    "slate roof": Look(textures.shingles(9, 7), (0.28, 0.32, 0.4), (0.58, 0.62, 0.7), 1.8, bump=0.9),
    "oak": Look(textures.planks(5), (0.38, 0.22, 0.1), (0.8, 0.58, 0.34), 1.1),
    "painted wood": Look(textures.planks(6), (0.05, 0.32, 0.34), (0.2, 0.58, 0.56), 1.2),
    "yellow wood": Look(textures.planks(6), (0.78, 0.54, 0.1), (0.96, 0.8, 0.3), 0.9),
    "bark": Look(textures.planks(14), (0.22, 0.15, 0.1), (0.5, 0.38, 0.27), 1.0, bump=1.0),
    "leaves": Look(textures.stones(800, 0.35, 0.12), (0.12, 0.3, 0.06), (0.5, 0.66, 0.16), 1.1, bump=1.0),
    "autumn leaves": Look(textures.stones(800, 0.35, 0.12), (0.55, 0.2, 0.05), (0.92, 0.62, 0.14), 1.1, bump=1.0),
    "flowers": Look(textures.stones(500, 0.4, 0.12), (0.78, 0.2, 0.4), (1.0, 0.86, 0.92), 1.0, bump=1.0),
    "blue tiles": Look(textures.checks(6), (0.1, 0.2, 0.52), (0.92, 0.9, 0.82), 0.9, 0.3, roughness=0.3),
    "green tiles": Look(textures.checks(6), (0.08, 0.38, 0.3), (0.9, 0.84, 0.62), 0.9, 0.3, roughness=0.3),
    "striped cloth": Look(textures.stripes(5), (0.72, 0.12, 0.1), (0.95, 0.92, 0.84), 1.2, 0.3),
    "blue cloth": Look(textures.stripes(6), (0.12, 0.26, 0.6), (0.96, 0.86, 0.5), 1.2, 0.3),
    "bronze": Look(textures.rough(1.2), (0.5, 0.36, 0.2), (0.86, 0.68, 0.42), 0.9, 0.4, roughness=0.35, metallic=1.0),
    "terracotta": Look(textures.rough(1.3), (0.62, 0.32, 0.2), (0.86, 0.56, 0.4), 0.7, 0.5),
    "window": Look(textures.checks(3), (0.12, 0.18, 0.26), (0.3, 0.42, 0.52), 0.75, 0.2, roughness=0.25),
}


def make_materials(rng: np.random.Generator) -> dict[str, bpy.types.Material]:
    """A material for every look, by name."""
    return {
        name: _material(name, look, child)
        for (name, look), child in zip(LOOKS.items(), rng.spawn(len(LOOKS)), strict=True)
    }


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
    tree.links.new(bump.outputs[0], surface.inputs["Normal"])
    tree.links.new(surface.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def _surface(tree: bpy.types.NodeTree, look: Look) -> bpy.types.Node:
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
    image.pack()
    return image
