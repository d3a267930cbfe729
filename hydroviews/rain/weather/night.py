"""Night with lamps: little light from the sky, lamps of the scene that stay bright, and lamps that light it.

    R = dark(B) + E B + D      linear light

E is the light of lamps that hang in the scene, D the lamps themselves and the air that they light. What the
photographs show clipped is taken for a lamp too (`light.expand_highlights`), if it is white and not in the sky: the sun
on a wall clips one colour or two. It is not darkened, and has a halo.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.compositing import COLOURS, LayerPlane, Layers
from hydroviews.rain.light import BRIGHTEST, CLIPPED, expand_highlights, glow
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import Colour, SceneStatistics
from hydroviews.rain.severity import wanted_harm
from hydroviews.rain.storm.world import in_metres, metres_and_focus, up_direction
from hydroviews.rain.weather import lamps, noise
from hydroviews.rain.weather.chain import Chain
from hydroviews.rain.weather.dark import AmbientPattern, darken, describe_ambient, draw_ambient, read_ambient
from hydroviews.rain.weather.haze import DEEPEST, distance
from hydroviews.rain.weather.noise import SensorNoise
from hydroviews.rain.weather.severity import LOSS, harm, solve_stops
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear, to_srgb
from hydroviews.scene.scenes import View

LAMPS = (2, 5)  # that hang in a scene
HIGH = 0.6  # of the scene's points, the share that lies below those where lamps hang
OFF_WALL = 0.3  # metres from such a point towards the cameras
WARM: Colour = (1.42, 0.93, 0.45)  # linear light of 2700 K, of luminance 1
COLD: Colour = (1.06, 0.99, 0.86)  # of 5000 K


@dataclass(frozen=True)
class Evening:
    """What all views of one night share; lamps shine more the darker it is."""

    ambient: AmbientPattern
    lamps: tuple[tuple[float, float, float], ...]  # places in the world, scene units
    colour: Colour  # of their light, of luminance 1
    power: float  # light at one metre from a lamp, when all other light is gone; that of day is 1
    extinction: float  # a metre, of the damp air


def draw_evening(rng: np.random.Generator, statistics: SceneStatistics) -> Evening:
    """Draw where lamps hang, and their light; it is not dark yet."""
    count, warmth = int(rng.integers(*LAMPS, endpoint=True)), float(rng.uniform(0.3, 1.0))
    return Evening(
        ambient=draw_ambient(rng, statistics.light),
        lamps=_hang(rng, statistics, count),
        colour=tuple(round(warmth * w + (1 - warmth) * c, 4) for w, c in zip(WARM, COLD, strict=True)),  # type: ignore[arg-type]
        power=float(rng.uniform(0.25, 0.5)),
        extinction=float(rng.uniform(0.01, 0.04)),
    )


def _hang(rng: np.random.Generator, statistics: SceneStatistics, count: int) -> tuple[tuple[float, float, float], ...]:
    """Places beside high points of the scene, on the side of the cameras; without points there are none."""
    points = statistics.points.positions
    if not len(points):
        return ()
    metres, _ = metres_and_focus(statistics.views, statistics.points, statistics.metres_per_unit)
    height = points @ up_direction(statistics.views)
    chosen = rng.choice(points[height >= np.quantile(height, HIGH)], count)
    inwards = np.mean([view.camera.centre for view in statistics.views], axis=0) - chosen
    length = np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
    placed = chosen + inwards / length * np.minimum(OFF_WALL / metres, length / 2)
    return tuple((float(x), float(y), float(z)) for x, y, z in placed.round(6))


@dataclass(frozen=True, eq=False)
class Lamplight:
    """The light of lamps in one view when all other light is gone, without its colour."""

    falling: NDArray[np.float32]  # [H, W], on what is shown; that of day is 1
    shining: NDArray[np.float32]  # [H, W], linear light of the lamps that hang in the scene, and of the air they light
    photographed: Image  # [H, W, 3], linear light beyond white of lamps in the photograph
    halo: float  # share of it that the air scatters on its way


def lamplight(evening: Evening, camera: Camera, linear: Image, far: NDArray, metres: float, focus: float) -> Lamplight:
    """The light of all lamps in a view.

    Args:
        evening: whose lamps they are.
        camera: of the view, in scene units.
        linear: what it shows by day, [H, W, 3].
        far: metres [H, W] to that, along the rays.
        metres: a scene unit.
        focus: metres to what the cameras look at.
    """
    camera = in_metres(camera, metres)
    ways = lamps.rays(camera)
    falling, shining = np.zeros(far.shape), np.zeros(far.shape)
    for lamp in evening.lamps:
        along, beside = lamps.along_and_beside(np.array(lamp) * metres, camera, ways)
        falling += evening.power * lamps.illumination(along, beside, far)
        shining += evening.power * evening.extinction / 4 * lamps.air_glow(along, beside, far)
        shining += BRIGHTEST * lamps.ball(along, beside, far, camera)
    white = (far < DEEPEST) & (linear.min(axis=-1) >= CLIPPED)
    grounded = linear * white[..., None]
    photographed = expand_highlights(grounded) - grounded
    halo = float(1 - np.exp(-evening.extinction * focus))
    return Lamplight(falling.astype(np.float32), shining.astype(np.float32), photographed, halo)


def light_up(linear: Image, evening: Evening, light: Lamplight) -> tuple[NDArray[np.float32], Image]:
    """E [H, W] and D [H, W, 3] of a view [H, W, 3] of linear light; lamps count for more the darker it is."""
    night = np.float32(1 - 0.5**evening.ambient.stops)
    is_lamp = light.photographed / np.maximum((BRIGHTEST - 1) * linear, np.float32(1e-6))
    kept = is_lamp * np.maximum(linear - darken(linear, evening.ambient), 0)
    hung = light.shining[..., None] * np.array(evening.colour, np.float32)
    return night * light.falling, kept + night * (hung + np.float32(light.halo) * glow(light.photographed))


def at_night(linear: Image, evening: Evening, lit: NDArray, added: Image) -> Image:
    """dark(B) + E B + D in linear light, for E [H, W] and D [H, W, 3]."""
    colour = np.array(evening.colour, np.float32)
    return darken(linear, evening.ambient) + lit[..., None] * colour * linear + added


def grade_evening(drawn: Evening, wanted: float, seen: SceneStatistics, clean: Sequence[Image]) -> Evening:
    """The pattern with its stops set so that samples at night differ from `clean` ones by the wanted harm.

    Raises:
        InputError: how far away things are cannot be told.
    """
    metres, focus = metres_and_focus(seen.views, seen.points, seen.metres_per_unit)
    scenes = []
    for view, sample in zip(seen.sampled_views, seen.samples, strict=True):
        far = distance(view, seen.points, metres, sample)
        scene = to_linear(sample)
        scenes.append((scene, lamplight(drawn, view.camera, scene, far, metres, focus)))

    def harm_of(stops: float) -> float:
        evening = replace(drawn, ambient=replace(drawn.ambient, stops=stops))
        lit = ((scene, light_up(scene, evening, shed)) for scene, shed in scenes)
        return harm((to_srgb(at_night(scene, evening, *light)) for scene, light in lit), clean)

    return replace(drawn, ambient=replace(drawn.ambient, stops=solve_stops(harm_of, wanted)))


class Lamps:
    """The light of a scene at night, as a part of a chain: E is light that falls on it, R, G and B is light added."""

    planes: ClassVar = {"E": LayerPlane("light of lamps", most=np.inf), **COLOURS}
    needs_optics = False

    def place(self, drawn: Evening, pattern: Pattern, statistics: SceneStatistics) -> "LitScene":
        """The lamps in a scene measured in metres."""
        return LitScene(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `at_night`."""
        added = np.stack([layers[channel] for channel in "RGB"], axis=-1)
        return to_srgb(at_night(to_linear(clean), read_evening(parameters), layers["E"], added))

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """Stops and lamps."""
        return f"{describe_ambient(parameters['ambient'])}, lamps: {len(parameters['lamps'])}"


def read_evening(parameters: Mapping[str, Any]) -> Evening:
    """The pattern that `LitScene` wrote among its parameters."""
    own = {name: parameters[name] for name in ("colour", "power", "extinction")}
    return Evening(**own, ambient=read_ambient(parameters["ambient"]), lamps=tuple(map(tuple, parameters["lamps"])))


class LitScene:
    """The light of one night on one scene."""

    def __init__(self, drawn: Evening, statistics: SceneStatistics) -> None:
        self._evening, self._points = drawn, statistics.points
        self._metres, self._focus = metres_and_focus(statistics.views, statistics.points, statistics.metres_per_unit)
        self.parameters: dict[str, Any] = {
            **asdict(drawn),
            "metres_per_unit": self._metres,
            "metres_estimated": statistics.metres_per_unit is None,
        }

    def prepare(self, camera: Camera, folder: Path) -> "LitScene":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """Channels E, R, G, B of `light_up`."""
        far = distance(view, self._points, self._metres, clean)
        linear = to_linear(clean)
        light = lamplight(self._evening, view.camera, linear, far, self._metres, self._focus)
        lit, added = light_up(linear, self._evening, light)
        return {"E": lit, **{channel: added[..., i] for i, channel in enumerate("RGB")}}


class Night(Chain):
    """`night`: a scene under its lamps, and the noise of the sensor that sees it."""

    parts: ClassVar = {"night": Lamps(), "noise": SensorNoise()}

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> dict[str, Any]:
        """Lamps, tint and noise from the seed, stops by the grade."""
        rng = pattern_generator(pattern, statistics)
        evening, sensor = draw_evening(rng, statistics), noise.draw_pattern(rng, pattern.level)
        wanted = wanted_harm(LOSS["night"][pattern.grade], statistics)
        return {"night": grade_evening(evening, wanted, statistics, statistics.samples), "noise": sensor}
