"""Noise of a camera's sensor in poor light.

Electrons arrive by chance and are read out with an error, so the variance at linear light L is `shot` L + `read`^2
(Foi et al. 2008). Layers keep the chance alone, in standard deviations: it does not depend on the picture.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear, to_srgb
from hydroviews.scene.scenes import View

SHOT = ((2e-4, 4e-4), (4e-4, 8e-4), (8e-4, 16e-4))  # by grade; one over the electrons that white paper gives
READ = ((5e-4, 10e-4), (8e-4, 15e-4), (12e-4, 25e-4))  # white paper is 1
LEVELS = 65536
PLANES = {f"N{channel}": LayerPlane(least=-np.inf, most=np.inf) for channel in "RGB"}


@dataclass(frozen=True)
class NoisePattern:
    """A sensor at its gain."""

    shot: float  # variance a unit of linear light
    read: float  # standard deviation in the dark, linear light


def draw_pattern(rng: np.random.Generator, grade: int) -> NoisePattern:
    """Draw a sensor in light (0), medium (1) or heavy (2) weather."""
    return NoisePattern(shot=float(rng.uniform(*SHOT[grade])), read=float(rng.uniform(*READ[grade])))


def standard_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Normal numbers of mean 0 and variance 1, one of 65,536 equally likely ones: within 4.33 deviations."""
    return np.take(_QUANTILES, rng.integers(LEVELS, size=shape, dtype=np.uint16))


_QUANTILES = ndtri((np.arange(LEVELS) + 0.5) / LEVELS).astype(np.float32)


def add_noise(linear: Image, layers: Layers, pattern: NoisePattern) -> Image:
    """Linear light [H, W, 3] as the sensor counts it; planes NR, NG and NB are in standard deviations."""
    noisy = linear * np.float32(pattern.shot)
    noisy += np.float32(pattern.read**2)
    np.sqrt(noisy, out=noisy)
    noisy *= np.stack([layers[name] for name in PLANES], axis=-1)
    noisy += linear
    return noisy


class SensorNoise:
    """Noise as the last part of a chain."""

    planes: ClassVar = PLANES
    needs_optics = False

    def place(self, drawn: NoisePattern, pattern: Pattern, statistics: SceneStatistics) -> "Noise":
        """Ignores the scene's statistics: only its name seeds the drawing."""
        return Noise(asdict(drawn), pattern, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `add_noise`."""
        return to_srgb(add_noise(to_linear(clean), layers, NoisePattern(**parameters)))

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """The noise of white and of black."""
        return describe_noise(parameters)


class Noise:
    """Fresh noise in every view."""

    def __init__(self, parameters: Mapping[str, Any], pattern: Pattern, statistics: SceneStatistics) -> None:
        self.parameters = parameters
        self._pattern, self._statistics = pattern, statistics

    def prepare(self, camera: Camera, folder: Path) -> "Noise":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """Channels NR, NG, NB: normal numbers."""
        rng = pattern_generator(self._pattern, self._statistics, "noise", view.name)
        chance = standard_normal(rng, (3, *clean.shape[:2]))
        return dict(zip(PLANES, chance, strict=True))


def describe_noise(parameters: Mapping[str, Any]) -> str:
    """A sensor as a phrase."""
    return "noise of {:.1%} in white and {:.2%} in black".format(
        np.hypot(np.sqrt(parameters["shot"]), parameters["read"]), parameters["read"]
    )
