"""What an embedded scene is made of, as data: pieces, lamps, a sky, and where photographs are taken."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import Path
from hydroviews.blender.embedded_scenes.meshes import Mesh

Rng = np.random.Generator
Vector = tuple[float, float, float]
Light = tuple[float, float, float]  # linear RGB


@dataclass(frozen=True)
class Piece:
    """A mesh of one material, turned about z and put somewhere; the texture sticks to the mesh's own axes."""

    name: str
    mesh: Mesh
    material: str  # a key of `looks.LOOKS`
    position: Vector = (0.0, 0.0, 0.0)
    turn: float = 0.0


@dataclass(frozen=True)
class Lamp:
    """A source of light that cameras do not see: a ball, or a rectangle that shines to one side if it has a size."""

    name: str
    position: Vector
    watts: float  # Blender's radiant power
    colour: Light = (1.0, 1.0, 1.0)
    radius: float = 0.1
    size: tuple[float, float] | None = None
    direction: Vector = (0.0, 0.0, -1.0)  # a rectangle shines this way


@dataclass(frozen=True)
class Sky:
    """Light from far away. Radiances are linear, 1 is white paper in the day's sun."""

    zenith: Light
    horizon: Light
    ground: Light
    glow: Light  # added towards the sun
    clouds: Light
    sun_direction: Vector  # of any length; below the horizon there is only its glow
    sun_strength: float = 0.0  # W/m^2 facing the sun
    sun_colour: Light = (1.0, 0.93, 0.82)


@dataclass(frozen=True)
class Design:
    """An embedded scene; everything in it is drawn from the generator that `make` is given."""

    make: Callable[[Rng], Iterable[Piece | Lamp]]
    sky: Sky
    path: Path
    samples: int = 20  # a pixel; what is left of the noise is removed by OpenImageDenoise
    diffuse_bounces: int = 2
    clean_error: float | None = None  # measured: error of plain 3DGS on clean views, over their fine detail
    drops_cost: float = 1.0  # measured: error that sharp drops leave in it, over what is predicted
