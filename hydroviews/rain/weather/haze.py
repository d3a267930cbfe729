"""Haze: what is far fades into the light of the air.

R = B t + A (1 - t) with t = exp(-beta d), in linear light (Koschmieder 1924): d is the distance along the ray, beta the
extinction by scattering, A the airlight. A black thing is told from the sky behind it by a contrast of 2 % up to the
meteorological range V = 3.912 / beta.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import Colour, SceneStatistics
from hydroviews.rain.severity import wanted_harm
from hydroviews.rain.storm.world import metres_and_focus
from hydroviews.rain.veil import veil
from hydroviews.rain.weather.severity import LOSS, harm, solve_ratio
from hydroviews.scene.cameras import Camera
from hydroviews.scene.depth import depth_path, ray_distance, view_depth
from hydroviews.scene.images import Image, to_linear, to_srgb
from hydroviews.scene.scenes import Points, View

RANGE = 3.912  # -ln 0.02
DEEPEST = 200.0  # metres of haze in front of the sky: fog is a layer
THINNEST, THICKEST = 1e-3, 3.0  # optical depth up to what the cameras look at


@dataclass(frozen=True)
class HazePattern:
    """The air of one scene."""

    extinction: float  # beta, a metre
    air: Colour  # airlight, relative to the scene's


def draw_pattern(rng: np.random.Generator) -> HazePattern:
    """Draw the air's light, a little darker than the brightest tenth of the scene and hardly coloured; no haze yet."""
    red, green, blue = (rng.uniform(0.85, 1.0) * (1 + 0.03 * rng.uniform(-1, 1, 3))).tolist()
    return HazePattern(extinction=0.0, air=(red, green, blue))


def grade_haze(drawn: HazePattern, wanted: float, seen: SceneStatistics, clean: Sequence[Image]) -> HazePattern:
    """The pattern with its extinction set so that hazy samples differ from `clean` ones by the wanted harm.

    Raises:
        InputError: how far away things are cannot be told.
    """
    metres, focus = metres_and_focus(seen.views, seen.points, seen.metres_per_unit)
    air = np.array(seen.light.air, np.float32) * np.array(drawn.air, np.float32)
    views = zip(seen.sampled_views, seen.samples, strict=True)
    scenes = [(to_linear(s), distance(view, seen.points, metres, s)) for view, s in views]

    def harm_of(extinction: float) -> float:
        clear = ((light, np.exp(-np.float32(extinction) * far)[..., None]) for light, far in scenes)
        return harm((to_srgb(light * t + air * (1 - t)) for light, t in clear), clean)

    return replace(drawn, extinction=solve_ratio(harm_of, wanted, THINNEST / focus, THICKEST / focus))


def distance(view: View, points: Points, metres_per_unit: float, picture: Image) -> NDArray[np.float32]:
    """Metres [H, W] from a camera to what its view [H, W, 3] shows, along the rays, at most DEEPEST.

    Raises:
        InputError: the view has neither a depth map nor a point of the scene in front of it, or an unreadable one.
    """
    depth = view_depth(view, points, picture)
    if not (np.isfinite(depth).any() or depth_path(view).is_file()):
        raise InputError(
            f"{view.name}: how far away things are cannot be told",
            found=f"no {depth_path(view)}, and none of the scene's {len(points)} points in the view",
            expected="a depth map or points",
            fix="add depth maps, or estimate the poses again with points",
        )
    metres = ray_distance(view.camera, depth) * metres_per_unit
    return np.minimum(metres, DEEPEST).astype(np.float32)


class Haze(Effect):
    """`haze`: H is cover by haze, 1 - t; the airlight is the same everywhere."""

    planes: ClassVar = {"H": LayerPlane("cover by haze", "mist")}
    needed = ("airlight",)
    words: ClassVar = {
        "extinction": "extinction of {:.3g} a metre",
        "visibility": "things are seen up to {:.0f} m",
        "metres_per_unit": "a unit of the capture is {:.3g} m",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> HazePattern:
        """Airlight from the seed, extinction by the grade."""
        drawn = draw_pattern(pattern_generator(pattern, statistics))
        wanted = wanted_harm(LOSS["haze"][pattern.grade], statistics)
        return grade_haze(drawn, wanted, statistics, statistics.samples)

    def place(self, drawn: HazePattern, pattern: Pattern, statistics: SceneStatistics) -> "HazyAir":
        """The haze in a scene measured in metres."""
        return HazyAir(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """B (1 - H) + A H in linear light."""
        light, air = to_linear(clean), np.array(parameters["airlight"], np.float32)
        light += layers["H"][..., None] * (air - light)
        return to_srgb(light)


class HazyAir:
    """A pattern of haze in one scene."""

    def __init__(self, drawn: HazePattern, statistics: SceneStatistics) -> None:
        metres, _ = metres_and_focus(statistics.views, statistics.points, statistics.metres_per_unit)
        self._extinction, self._metres, self._points = drawn.extinction, metres, statistics.points
        self.parameters: dict[str, Any] = {
            **asdict(drawn),
            "airlight": [round(a * b, 6) for a, b in zip(statistics.light.air, drawn.air, strict=True)],
            "metres_per_unit": metres,
            "metres_estimated": statistics.metres_per_unit is None,
        }
        if drawn.extinction > 0:
            self.parameters["visibility"] = RANGE / drawn.extinction  # V, in metres

    def prepare(self, camera: Camera, folder: Path) -> "HazyAir":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """Channel H: cover of the view by haze."""
        return {"H": veil(self._extinction * distance(view, self._points, self._metres, clean), clean)}
