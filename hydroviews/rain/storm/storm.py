"""One storm seen from every camera: drops in the world, hidden by what is nearer, lit by what is around them.

Single drops are drawn where a camera could tell them apart (`drop_sizes`, `rasterise`); the rest of the rain is
a veil that grows with distance. Both are composited in linear light: a drop is a wide lens, which shows the light of
its surroundings, so streaks are bright near lamps and vanish in the dark.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.light import expand_highlights, rain_light
from hydroviews.rain.scene_statistics import Light, SceneStatistics
from hydroviews.rain.storm.drop_sizes import draw_cloud, optical_depth, reach
from hydroviews.rain.storm.rasterise import Shutter, draw, project
from hydroviews.rain.storm.world import horizontal, in_metres, metres_and_focus, up_direction
from hydroviews.rain.veil import veil
from hydroviews.scene.cameras import Camera
from hydroviews.scene.depth import ray_distance, view_depth
from hydroviews.scene.images import Image, luminance, to_linear
from hydroviews.scene.scenes import View

THICKEST = 0.6  # the most that the veil hides: behind it a scene must stay visible


@dataclass(frozen=True)
class StormPattern:
    """What all views of one storm share."""

    rate: float  # mm/h; 2.5 is the limit of light rain, 50 that of violent rain
    density: float  # times the number of drops that Marshall and Palmer counted at this rate
    wind_speed: float  # m/s
    wind_angle: float  # degrees counter-clockwise, seen from above, from where the first view looks
    turbulence: float  # m/s, standard deviation of each component of a drop's velocity
    exposure: float  # seconds that the shutter is open
    aperture: float  # metres, diameter of the lens's opening: what blurs near drops
    interval: float  # seconds from one view to the next by name; 0 is a frozen storm
    seed: int  # of the drops


RATES = ((6.0, 14.0), (22.0, 40.0), (65.0, 100.0))  # mm/h by grade
DENSITIES = (1.5, 3.0, 6.0)
WINDS = ((0.0, 1.5), (0.5, 3.0), (1.5, 5.0))  # m/s by grade


def draw_pattern(rng: np.random.Generator, grade: int) -> StormPattern:
    """Draw a light (0), medium (1) or heavy (2) storm."""
    wind_speed = float(rng.uniform(*WINDS[grade]))
    return StormPattern(
        rate=float(rng.uniform(*RATES[grade])),
        density=DENSITIES[grade],
        wind_speed=wind_speed,
        wind_angle=float(rng.uniform(0, 360)),
        turbulence=0.15 + 0.1 * wind_speed,
        exposure=float(1 / np.exp(rng.uniform(np.log(60), np.log(200)))),
        aperture=float(rng.uniform(0.002, 0.005)),
        interval=1.0,
        seed=int(rng.integers(2**32)),
    )


def skylight(light: Light) -> float:
    """How many times brighter a drop is, at most, than what the pictures around it show.

    Most of what a drop gathers comes from above and beside the picture, and is as bright as the brightest parts of
    the scene rather than as its mean; half way between the two, on a scale of ratios, is taken.
    """
    mean, air = (float(luminance(np.array(colour, np.float32))) for colour in (light.mean, light.air))
    return float(np.sqrt(air / mean)) if mean > 0 else 1.0


def storm_light(clean: Image, light: Light) -> NDArray[np.float32]:
    """The linear light [H, W, 3] of drops in front of a view [H, W, 3]: `rain_light` times the skylight.

    But the sky's share makes no drop brighter than the scene's air: rain is not brighter than the sky.
    """
    shown = rain_light(expand_highlights(to_linear(clean)))
    air = luminance(np.array(light.air, np.float32))
    lift = np.clip(air / np.maximum(luminance(shown), 1e-6), 1, skylight(light))
    return shown * lift[..., None].astype(np.float32)


class Storm:
    """A storm over one scene, ready to fall on its views."""

    def __init__(self, pattern: StormPattern, statistics: SceneStatistics) -> None:
        """Place the storm in the scene.

        Args:
            pattern: what falls.
            statistics: of the scene; a scale that they do not have is estimated from what its cameras look at.

        Raises:
            InputError: neither scale nor gravity can be told from the capture.
        """
        self._pattern, self._statistics = pattern, statistics
        self._scale, self._focus = metres_and_focus(statistics.views, statistics.points, statistics.metres_per_unit)
        self._turn = {view.name: i for i, view in enumerate(statistics.views)}
        up = up_direction(statistics.views)
        wind = pattern.wind_speed * horizontal(statistics.views[0].camera, up, pattern.wind_angle)
        self.cloud = draw_cloud(pattern.rate, pattern.density, wind, pattern.turbulence, up, pattern.seed)
        self.parameters: dict[str, Any] = {
            **asdict(pattern),
            "drops": len(self.cloud),
            "reach": reach(pattern.rate),
            "wind": wind.tolist(),
            "up": up.tolist(),
            "metres_per_unit": self._scale,
            "metres_estimated": statistics.metres_per_unit is None,
            "focus": self._focus,
            "skylight": skylight(statistics.light),
        }

    def prepare(self, camera: Camera, folder: Path) -> "Storm":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> dict[str, NDArray[np.float32]]:
        """What falls on a view: rainy = (1 - M)(1 - V) clean + (R, G, B), in linear light.

        Args:
            clean: [H, W, 3], sRGB-encoded.
            view: one of the scene's.

        Returns:
            Planes [H, W]: M cover by drops, V by the veil, R, G, B the light of both.
        """
        camera = in_metres(view.camera, self._scale)
        depth = view_depth(view, self._statistics.points, clean) * np.float32(self._scale)
        drops = self.drops(view, camera, depth)[..., None]
        veil = self.veil(camera, depth, clean)[..., None]
        light = storm_light(clean, self._statistics.light)
        added = (drops + (1 - drops) * veil) * light  # far drops show their surroundings as near ones do
        return {"M": drops[..., 0], "V": veil[..., 0], **{c: added[..., i] for i, c in enumerate("RGB")}}

    def drops(self, view: View, camera: Camera, depth: NDArray) -> NDArray[np.float32]:
        """Cover [H, W] by drops; camera and depth in metres."""
        pattern = self._pattern
        time = self._turn[view.name] * pattern.interval
        shutter = Shutter(time, pattern.exposure, pattern.aperture, self._focus)
        return draw(project(self.cloud, camera, shutter), depth)

    def veil(self, camera: Camera, depth: NDArray, clean: Image) -> NDArray[np.float32]:
        """Cover [H, W] by the rain that is too fine or too far to be drawn, at most THICKEST."""
        distance = ray_distance(camera, depth)
        return veil(optical_depth(self._pattern.rate, self._pattern.density, distance), clean, THICKEST)
