"""How surfaces look: a pattern in two colours, by the name that pieces ask for."""

from dataclasses import dataclass

from hydroviews.blender.embedded_scenes import textures
from hydroviews.blender.embedded_scenes.textures import Pattern
from hydroviews.blender.embedded_scenes.textures_indoor import carpet, damask, folds, goods, landscape, parquet, plaid

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
    "parquet": Look(parquet(4, 5), (0.4, 0.22, 0.11), (0.8, 0.56, 0.32), 2.0, 0.2, roughness=0.4),
    "walnut": Look(textures.planks(5), (0.2, 0.11, 0.06), (0.5, 0.31, 0.18), 0.8, 0.4, roughness=0.45),
    "green wallpaper": Look(damask(4), (0.24, 0.42, 0.34), (0.7, 0.78, 0.62), 1.3, 0.1),
    "cream wallpaper": Look(damask(5), (0.7, 0.52, 0.34), (0.93, 0.87, 0.74), 1.2, 0.1),
    "ceiling": Look(textures.rough(1.3), (0.8, 0.78, 0.73), (0.97, 0.95, 0.9), 1.5, 0.5),
    "rug": Look(carpet(5), (0.52, 0.12, 0.1), (0.9, 0.8, 0.6), 2.8, 0.4),
    "curtain": Look(folds(6), (0.46, 0.14, 0.12), (0.88, 0.56, 0.4), 1.0, 0.6),
    "plaid": Look(plaid(5), (0.14, 0.24, 0.42), (0.88, 0.8, 0.62), 0.8, 0.3),
    "red plaid": Look(plaid(6), (0.5, 0.12, 0.1), (0.92, 0.76, 0.4), 0.6, 0.3),
    "upholstery": Look(damask(6), (0.12, 0.36, 0.4), (0.5, 0.68, 0.62), 0.9, 0.4),
    "mustard cloth": Look(damask(7), (0.62, 0.4, 0.08), (0.93, 0.74, 0.32), 0.8, 0.4),
    "dawn": Look(landscape, (0.2, 0.22, 0.36), (0.93, 0.58, 0.42), 1.2, 0.2),
    "meadow": Look(landscape, (0.12, 0.3, 0.16), (0.55, 0.74, 0.86), 1.0, 0.2),
    "coast": Look(landscape, (0.1, 0.24, 0.42), (0.74, 0.8, 0.72), 0.8, 0.2),
    "red books": Look(textures.stripes(4), (0.42, 0.08, 0.08), (0.8, 0.34, 0.22), 0.3, 0.2),
    "blue books": Look(textures.stripes(5), (0.1, 0.18, 0.4), (0.4, 0.52, 0.72), 0.34, 0.2),
    "green books": Look(textures.stripes(3), (0.1, 0.28, 0.16), (0.5, 0.62, 0.38), 0.26, 0.2),
    "pale books": Look(textures.stripes(4), (0.62, 0.5, 0.32), (0.95, 0.9, 0.78), 0.32, 0.2),
    "gilt": Look(textures.rough(1.2), (0.56, 0.4, 0.14), (0.92, 0.76, 0.4), 0.4, 0.6),
    "china": Look(damask(4), (0.1, 0.22, 0.56), (0.94, 0.93, 0.88), 0.3, 0.1, roughness=0.3),
    "green china": Look(damask(3), (0.1, 0.4, 0.3), (0.92, 0.9, 0.76), 0.3, 0.1, roughness=0.3),
    "lampshade": Look(folds(9), (0.86, 0.6, 0.32), (1.0, 0.9, 0.7), 0.5, emission=1.4),
    "embers": Look(textures.stones(120, 0.3), (0.9, 0.2, 0.04), (1.0, 0.75, 0.3), 0.4, emission=3.0),
    "wet cobbles": Look(textures.stones(170), (0.32, 0.31, 0.32), (0.66, 0.63, 0.6), 2.8, 0.7, roughness=0.42),
    "dark brick": Look(textures.bricks(10, 4), (0.4, 0.18, 0.14), (0.68, 0.38, 0.3), 1.6, bump=0.8),
    "amber window": Look(folds(5), (0.9, 0.42, 0.12), (1.0, 0.8, 0.42), 0.9, emission=1.3),
    "pale window": Look(folds(3), (0.94, 0.72, 0.42), (1.0, 0.94, 0.8), 1.1, emission=1.6),
    "curtained window": Look(plaid(4), (0.62, 0.26, 0.14), (1.0, 0.76, 0.4), 0.7, emission=0.8),
    "shop window": Look(goods(4, 9), (0.62, 0.42, 0.24), (1.0, 0.86, 0.6), 1.9, emission=1.5),
    "book shop window": Look(goods(7, 24), (0.5, 0.34, 0.2), (1.0, 0.82, 0.52), 1.8, emission=1.3),
    "red sign": Look(textures.stripes(3), (0.9, 0.1, 0.08), (1.0, 0.45, 0.3), 0.3, emission=1.6),
    "white sign": Look(textures.stripes(3), (0.8, 0.9, 0.95), (1.0, 1.0, 0.95), 0.3, emission=1.4),
    "bulb": Look(textures.rough(), (1.0, 0.8, 0.5), (1.0, 0.88, 0.64), 0.5, emission=20.0),
    "iron": Look(textures.rough(1.2), (0.08, 0.1, 0.1), (0.26, 0.28, 0.27), 0.6, 0.4),
    "tyre": Look(textures.rough(1.2), (0.06, 0.06, 0.06), (0.2, 0.2, 0.2), 0.4, 0.4),
    "chrome": Look(textures.rough(1.2), (0.6, 0.6, 0.62), (0.9, 0.9, 0.92), 0.5, 0.2, roughness=0.3, metallic=1.0),
    "red paint": Look(textures.rough(1.5), (0.58, 0.08, 0.07), (0.8, 0.18, 0.13), 1.2, 0.05, roughness=0.35),
    "blue paint": Look(textures.rough(1.5), (0.1, 0.26, 0.5), (0.26, 0.46, 0.7), 1.2, 0.05, roughness=0.35),
    "cream paint": Look(textures.rough(1.5), (0.78, 0.72, 0.56), (0.94, 0.9, 0.76), 1.2, 0.05, roughness=0.35),
    "green paint": Look(textures.rough(1.5), (0.12, 0.34, 0.24), (0.28, 0.54, 0.38), 1.2, 0.05, roughness=0.35),
    "posters": Look(goods(3, 5), (0.5, 0.4, 0.3), (1.0, 0.95, 0.85), 2.0, 0.2),
    "meadow grass": Look(textures.rough(1.2), (0.2, 0.32, 0.1), (0.52, 0.6, 0.24), 2.2, bump=0.8),
    "gravel": Look(textures.stones(700, 0.25), (0.5, 0.46, 0.4), (0.86, 0.8, 0.7), 1.6, bump=0.8),
    "water": Look(textures.rough(1.9), (0.08, 0.13, 0.1), (0.15, 0.2, 0.15), 2.6, bump=0.05, roughness=0.06),
    "lily pad": Look(textures.rough(1.3), (0.16, 0.38, 0.16), (0.42, 0.6, 0.3), 0.8, 0.2, roughness=0.45),
    "reed": Look(textures.rough(1.2), (0.3, 0.4, 0.12), (0.66, 0.7, 0.34), 0.9, 0.2),
    "foliage": Look(textures.rough(1.2), (0.24, 0.42, 0.12), (0.6, 0.72, 0.28), 0.9, 0.2),
    "yellow leaf": Look(textures.rough(1.2), (0.55, 0.48, 0.1), (0.92, 0.8, 0.28), 0.9, 0.2),
    "red leaf": Look(textures.rough(1.2), (0.42, 0.12, 0.08), (0.78, 0.36, 0.2), 0.9, 0.2),
    "blossom": Look(textures.stones(300, 0.4, 0.4), (0.86, 0.4, 0.56), (1.0, 0.86, 0.9), 0.9, 0.2),
    "undergrowth": Look(textures.stones(800, 0.35, 0.2), (0.16, 0.28, 0.08), (0.44, 0.54, 0.22), 1.1, bump=1.0),
    "birch bark": Look(textures.rough(1.1), (0.3, 0.28, 0.26), (0.92, 0.9, 0.86), 0.5, 0.4),
    "wet flags": Look(textures.bricks(5, 4, 0.02), (0.3, 0.29, 0.28), (0.56, 0.53, 0.5), 3.2, 0.25, roughness=0.16),
    "daylight": Look(textures.rough(1.9), (0.9, 0.94, 0.98), (0.98, 0.99, 1.0), 3.0, emission=1.3),
    "skin": Look(textures.rough(1.6), (0.74, 0.54, 0.43), (0.94, 0.76, 0.64), 0.6, 0.1),
    "ice": Look(textures.stones(500, 0.3, 0.6), (0.78, 0.86, 0.9), (0.97, 0.99, 1.0), 0.7, 0.5, roughness=0.3),
    "fish skin": Look(textures.shingles(26, 26), (0.36, 0.42, 0.48), (0.84, 0.87, 0.9), 0.5, 0.2, roughness=0.25),
    "salmon skin": Look(textures.shingles(26, 26), (0.7, 0.34, 0.28), (0.94, 0.66, 0.56), 0.5, 0.2, roughness=0.25),
    "orange peel": Look(textures.rough(0.9), (0.86, 0.42, 0.06), (0.98, 0.62, 0.16), 0.4, 0.2, roughness=0.45),
    "apple skin": Look(textures.rough(1.4), (0.6, 0.07, 0.06), (0.86, 0.4, 0.2), 0.3, 0.05, roughness=0.3),
    "lime peel": Look(textures.rough(1.2), (0.26, 0.46, 0.1), (0.6, 0.74, 0.24), 0.3, 0.1, roughness=0.4),
    "plum skin": Look(textures.rough(1.4), (0.2, 0.08, 0.22), (0.44, 0.22, 0.44), 0.3, 0.05, roughness=0.3),
    "lemon peel": Look(textures.rough(1.0), (0.86, 0.72, 0.14), (0.98, 0.9, 0.4), 0.3, 0.1, roughness=0.45),
    "green glass": Look(textures.rough(1.9), (0.04, 0.18, 0.08), (0.12, 0.36, 0.18), 0.5, 0.0, roughness=0.08),
    "brown glass": Look(textures.rough(1.9), (0.16, 0.07, 0.02), (0.36, 0.18, 0.08), 0.5, 0.0, roughness=0.08),
    "sailcloth": Look(textures.stripes(12), (0.74, 0.66, 0.52), (0.95, 0.9, 0.78), 1.2, 0.3),
    "green cloth": Look(textures.stripes(4), (0.12, 0.36, 0.24), (0.93, 0.9, 0.8), 1.2, 0.3),
}
