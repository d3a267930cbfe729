"""The contract of an effect: everything that building, verifying and describing a data set needs of a kind of rain.

    drawn = effect.draw(pattern, statistics)              the parameters of a pattern, from its seed
    rain = effect.place(drawn, pattern, statistics)       the pattern on one scene
    ready = rain.prepare(camera, folder)                  prepared for an image size and focal length
    layers = fall(ready, clean, view)                     the layers of one view
    rainy = effect.composite(rain.parameters, clean, layers)

A new effect is a class in a file, registered as an entry point of the group `hydroviews.effects` or named in full as
`package.module:Class` (see `registry.find_effect`).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View


class PreparedRain(Protocol):
    """Rain that is prepared for views of one size and focal length."""

    def layers(self, clean: Image, view: View) -> Layers:
        """The layers of a view: float32 planes [H, W] by channel name.

        Args:
            clean: [H, W, 3], sRGB-encoded, [0, 1].
            view: a view of the scene.
        """
        ...


class Rain(Protocol):
    """A pattern on one scene."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """All drawn parameters, as JSON; the same for all cameras."""
        ...

    def prepare(self, camera: Camera, folder: Path) -> PreparedRain:
        """Prepare for a camera's size and intrinsics; slow results are stored in `folder`."""
        ...


class Effect(ABC):
    """A kind of rain. Effects are created without arguments and have no state."""

    planes: ClassVar[Mapping[str, LayerPlane]]  # of its layer files, by channel name
    needs_optics: ClassVar[bool] = False  # whether rain is prepared for every size and focal length of a capture
    falling: ClassVar[str | None] = None  # the plane in which falling drops leave streaks
    needed: ClassVar[tuple[str, ...]] = ()  # parameters without which `composite` or `seed_density` cannot do
    words: ClassVar[Mapping[str, str]] = {}  # how data cards put a parameter, such as {"rate": "{:.0f} mm/h"}

    @abstractmethod
    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> Any:
        """Draw the parameters of a pattern as a dataclass, so that the loss on this scene fits the grade.

        Draw all random numbers from `patterns.pattern_generator(pattern, statistics)`.
        """

    @abstractmethod
    def place(self, drawn: Any, pattern: Pattern, statistics: SceneStatistics) -> Rain:
        """Place the drawn rain on the scene.

        Raises:
            InputError: the scene lacks what this rain needs, such as a scale.
        """

    @abstractmethod
    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """The rainy view [H, W, 3], sRGB-encoded, [0, 1]; it depends on the arguments only."""

    def covers(self, layers: Layers) -> dict[str, NDArray[np.float32]]:
        """The cover of a view by water, mist and streaks, [H, W] each.

        Several planes of one kind are united. Planes that `layers` lacks do not count.
        """
        covers: dict[str, NDArray[np.float32]] = {}
        for key, plane in self.planes.items():
            if plane.share and key in layers:
                cover = layers[key]
                if plane.share in covers:
                    cover = np.float32(1) - (1 - covers[plane.share]) * (1 - cover)
                covers[plane.share] = cover
        return covers

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """The main parameters as a phrase for data cards; may be empty."""
        return ", ".join(form.format(parameters[name]) for name, form in self.words.items() if name in parameters)

    def seed_density(self, parameters: Mapping[str, Any], layers: Layers) -> float | None:
        """Streak seeds a pixel, measured from a view's layers, for effects whose rain has seeds."""
        return None


def fall(rain: PreparedRain, clean: Image, view: View) -> Layers:
    """The layers of a view as their file holds them, rounded to half floats.

    The rainy view is computed from these rounded layers, so it can be computed again from the file.
    """
    return {name: plane.astype(np.float16).astype(np.float32) for name, plane in rain.layers(clean, view).items()}
