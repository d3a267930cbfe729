"""How surfaces look: a pattern in two colours, by the name that pieces ask for."""

from dataclasses import dataclass

from hydroviews.blender import textures
from hydroviews.blender.textures import Pattern

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
    emission: float = 0.0  # above 0 the surface glows: radiance where its colour is white


# A texture is drawn from a generator that goes by place in this table: new looks belong at its end.
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
