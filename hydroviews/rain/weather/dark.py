"""A dark rainy afternoon: less light, softer and bluer, and a sensor that is noisy for want of it.

In linear light B becomes g p (B / p)^c: g is the exposure and the tint, c < 1 the contrast that clouds take, p the
scene's mean brightness, around which contrast shrinks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import Colour, Light, SceneStatistics
from hydroviews.rain.severity import wanted_harm
from hydroviews.rain.weather import noise
from hydroviews.rain.weather.severity import LOSS, harm, solve_stops
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, luminance, to_linear, to_srgb
from hydroviews.scene.scenes import View

DIMMEST_PIVOT = 1e-3  # of a scene that is black


@dataclass(frozen=True)
class AmbientPattern:
    """The light that is left."""

    stops: float  # of light that are missing at the pivot; a stop is a factor of 2
    flatness: float  # contrast c = 1 / (1 + flatness stops)
    tint: Colour  # factor of each channel, a stop
    pivot: float  # p, linear light


@dataclass(frozen=True)
class DarkPattern:
    """A dark afternoon, as a camera takes it."""

    ambient: AmbientPattern
    noise: noise.NoisePattern


def draw_ambient(rng: np.random.Generator, light: Light) -> AmbientPattern:
    """Draw softness and tint of a clouded sky's light; it is not dark yet.

    Clouds spread the sun's light over the sky, which is bluer: 6500 to 8000 K where the sun's is 5500.
    """
    blue = float(rng.uniform(0.0, 0.05))
    pivot = max(float(luminance(np.array(light.mean, np.float32))), DIMMEST_PIVOT)
    return AmbientPattern(0.0, float(rng.uniform(0.03, 0.08)), (1 - blue, 1.0, 1 + blue), round(pivot, 6))


def darken(linear: Image, pattern: AmbientPattern) -> NDArray[np.float32]:
    """Linear light [..., 3] under a dark sky."""
    contrast = 1 / (1 + pattern.flatness * pattern.stops)
    gain = 0.5**pattern.stops * pattern.pivot ** (1 - contrast) * np.array(pattern.tint) ** pattern.stops
    dark = np.power(linear, np.float32(contrast))
    dark *= gain.astype(np.float32)
    return dark


def grade_ambient(
    drawn: AmbientPattern, wanted: float, seen: SceneStatistics, clean: Sequence[Image]
) -> AmbientPattern:
    """The pattern with its stops set so that dark samples differ from `clean` ones by the wanted harm."""
    scenes = [to_linear(sample) for sample in seen.samples]

    def harm_of(stops: float) -> float:
        return harm((to_srgb(darken(scene, replace(drawn, stops=stops))) for scene in scenes), clean)

    return replace(drawn, stops=solve_stops(harm_of, wanted))


def read_ambient(parameters: Mapping[str, Any]) -> AmbientPattern:
    """The pattern that `asdict` wrote."""
    return AmbientPattern(**{**parameters, "tint": tuple(parameters["tint"])})


class Ambient:
    """Darkness as the first part of a chain; it needs no layer."""

    planes: ClassVar[Mapping[str, LayerPlane]] = {}
    needs_optics = False

    def place(self, drawn: AmbientPattern, pattern: Pattern, statistics: SceneStatistics) -> "Darkness":
        """Darkness is the same everywhere."""
        return Darkness(asdict(drawn))

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `darken`."""
        return to_srgb(darken(to_linear(clean), read_ambient(parameters)))

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """The stops."""
        return describe_ambient(parameters)


@dataclass(frozen=True)
class Darkness:
    """Nothing is added where light is taken."""

    parameters: Mapping[str, Any]

    def prepare(self, camera: Camera, folder: Path) -> "Darkness":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """None."""
        return {}


class Dark(Effect):
    """`dark`: NR, NG and NB are the sensor's noise in standard deviations."""

    planes: ClassVar = noise.PLANES
    needed = ("ambient", "noise")

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> DarkPattern:
        """Tint, softness and noise from the seed, stops by the grade."""
        rng = pattern_generator(pattern, statistics)
        drawn, sensor = draw_ambient(rng, statistics.light), noise.draw_pattern(rng, pattern.level)
        wanted = wanted_harm(LOSS["dark"][pattern.grade], statistics)
        return DarkPattern(grade_ambient(drawn, wanted, statistics, statistics.samples), sensor)

    def place(self, drawn: DarkPattern, pattern: Pattern, statistics: SceneStatistics) -> noise.Noise:
        """The sensor, whose noise is all that is drawn for a view."""
        return noise.Noise(asdict(drawn), pattern, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """Darkened and then noisy, as a chain of both in one step."""
        dark = darken(to_linear(clean), read_ambient(parameters["ambient"]))
        return to_srgb(noise.add_noise(dark, layers, noise.NoisePattern(**parameters["noise"])))

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """Stops and noise."""
        parts = describe_ambient(parameters["ambient"]), noise.describe_noise(parameters["noise"])
        return ", ".join(parts)


def describe_ambient(parameters: Mapping[str, Any]) -> str:
    """Darkness as a phrase."""
    return "darker by {stops:.2f} stops".format(**parameters)
