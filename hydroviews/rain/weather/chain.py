"""Effects one after another, in the order of the light's way: each falls on what those before it left of the view.

The layers of all parts are kept, under names such as `haze.H`: the part's name, a dot and its plane's.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Protocol

from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.effect import Effect, PreparedRain, Rain, fall
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import SceneStatistics, measure_light
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View

NOWHERE = Path("nowhere")  # for what keeps nothing


class Part(Protocol):
    """What a chain asks of an effect; how hard it is, the chain decides."""

    @property
    def planes(self) -> Mapping[str, LayerPlane]:
        """Of its layer files."""
        ...

    @property
    def needs_optics(self) -> bool:
        """Whether it is prepared for every size and focal length."""
        ...

    def place(self, drawn: Any, pattern: Pattern, statistics: SceneStatistics) -> Rain:
        """What was drawn, on the scene as this part finds it."""
        ...

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """What it makes of a view."""
        ...

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """Its main parameters as a phrase."""
        ...


class Chain(Effect):
    """An effect made of parts; a subclass names them and draws each one's pattern.

    `draw` returns a dataclass or mapping with a field for every part.
    """

    parts: ClassVar[Mapping[str, Part]]  # by name, in the order of the light's way

    def __init_subclass__(cls) -> None:
        parts = cls.parts.items()
        cls.planes = {f"{name}.{key}": plane for name, part in parts for key, plane in part.planes.items()}
        cls.needs_optics = any(part.needs_optics for _, part in parts)
        cls.needed = tuple(cls.parts)

    def place(self, drawn: Mapping[str, Any], pattern: Pattern, statistics: SceneStatistics) -> "ChainedRain":
        """Every part on the scene as those before it left it; what is on the lens is no part of the scene."""
        rains: dict[str, Rain] = {}
        for name, part in self.parts.items():
            rains[name] = part.place(drawn[name], pattern, statistics)
            if not part.needs_optics:
                statistics = seen_through(part, rains[name], statistics)
        return ChainedRain(self.parts, rains)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """What the last part leaves of the view."""
        for name, part in self.parts.items():
            own = {key: layers[f"{name}.{key}"] for key in part.planes}
            clean = part.composite(parameters[name], clean, own)
        return clean

    def describe(self, parameters: Mapping[str, Any]) -> str:
        """The descriptions of all parts, joined."""
        phrases = {name: part.describe(parameters[name]) for name, part in self.parts.items() if name in parameters}
        return "; ".join(f"{name}: {phrase}" for name, phrase in phrases.items() if phrase)


class ChainedRain:
    """The parts of a chain on one scene."""

    def __init__(self, parts: Mapping[str, Part], rains: Mapping[str, Rain]) -> None:
        self._parts, self._rains = parts, rains
        self.parameters = {name: dict(rain.parameters) for name, rain in rains.items()}

    def prepare(self, camera: Camera, folder: Path) -> "PreparedChain":
        """All parts made ready; each keeps what takes long in a folder of its own."""
        ready = {name: rain.prepare(camera, folder / name) for name, rain in self._rains.items()}
        return PreparedChain(self._parts, self.parameters, ready)


class PreparedChain:
    """The parts of a chain, ready to fall on views of one size and focal length."""

    def __init__(
        self, parts: Mapping[str, Part], parameters: Mapping[str, Any], ready: Mapping[str, PreparedRain]
    ) -> None:
        self._parts, self._parameters, self._ready = parts, parameters, ready

    def layers(self, clean: Image, view: View) -> Layers:
        """The planes of all parts, each of what falls on the view that the parts before it left."""
        return dict(self._fall(clean, view))

    def _fall(self, picture: Image, view: View) -> Iterator[tuple[str, Any]]:
        *before, last = self._parts
        for name in before:
            layers = fall(self._ready[name], picture, view)
            picture = self._parts[name].composite(self._parameters[name], picture, layers)
            yield from ((f"{name}.{key}", plane) for key, plane in layers.items())
        yield from ((f"{last}.{key}", plane) for key, plane in self._ready[last].layers(picture, view).items())


def seen_through(part: Part, rain: Rain, statistics: SceneStatistics) -> SceneStatistics:
    """What the next part may know of the scene: its samples and its light, as this part leaves them."""
    samples = []
    for view, sample in zip(statistics.sampled_views, statistics.samples, strict=True):
        layers = fall(rain.prepare(view.camera, NOWHERE), sample, view)
        samples.append(part.composite(rain.parameters, sample, layers))
    return replace(statistics, samples=tuple(samples), light=measure_light(samples))
