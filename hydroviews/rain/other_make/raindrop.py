"""Water on the lens of another make, as an effect: D is cover by drops, F by mist, and all of it in encoded values."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.effect import Effect
from hydroviews.rain.other_make.drops import LensPattern, draw_pattern, drops_on
from hydroviews.rain.other_make.lens import LensMap, Plane, map_lens, see_through
from hydroviews.rain.other_make.mist import mist_cover
from hydroviews.rain.other_make.severity import grade_lens
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View

ADDED = ("ER", "EG", "EB")  # encoded values that are added


class OtherRaindrops(Effect):
    """`raindrop-b`: R = (1 - D) (1 - F) B + E, in encoded values; E is of drops and mist together."""

    planes: ClassVar = {
        "D": LayerPlane("cover by drops", "water"),
        "F": LayerPlane("cover by mist", "mist"),
        **{channel: LayerPlane() for channel in ADDED},
    }
    needs_optics = True
    words: ClassVar = {
        "coverage": "drops over {:.0%} of the picture",
        "radius_mean": "of a mean radius of {:.3f} picture sides",
        "aperture_blades": "blurred by an aperture of {} blades (0: Gaussian)",
        "mist": "mist that hides {:.0%} where it is densest",
        "mist_finest": "as fine as {:.0f} waves a side",
        "key_frames": "a sequence of {} key frames (0: one a view)",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> LensPattern:
        """A lens of the grade; mist, and if need be coverage, set by it."""
        drawn = draw_pattern(pattern_generator(pattern, statistics), pattern.level)
        return grade_lens(drawn, pattern.grade, statistics)

    def place(self, drawn: LensPattern, pattern: Pattern, statistics: SceneStatistics) -> "WetLens":
        """The lens in front of the scene, of which it needs the order of views alone."""
        return WetLens(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """(1 - D) (1 - F) B + E."""
        added = np.stack([layers[channel] for channel in ADDED], axis=-1)
        passing = (1 - layers["D"]) * (1 - layers["F"])
        return np.clip(clean * passing[..., None] + added, 0, 1)


class WetLens:
    """A pattern on one scene."""

    def __init__(self, drawn: LensPattern, statistics: SceneStatistics) -> None:
        self.parameters = asdict(drawn)
        self._drawn, self._names = drawn, [view.name for view in statistics.views]

    def prepare(self, camera: Camera, folder: Path) -> "PreparedLens":
        """The lens in front of this camera; nothing is kept on disk."""
        return PreparedLens(self._drawn, self._names, camera)


class PreparedLens:
    """Water in front of one camera. The key frame that was asked for last is held."""

    def __init__(self, pattern: LensPattern, names: list[str], camera: Camera) -> None:
        self._pattern, self.camera = pattern, camera
        self._order = {name: i for i, name in enumerate(names)}
        self._held: tuple[int, LensMap, Plane] | None = None

    @cached_property
    def _frames(self) -> int:
        return self._pattern.key_frames or len(self._order)

    def layers(self, clean: Image, view: View) -> Layers:
        """Planes D, F, ER, EG and EB of a view."""
        lens, mist = self._key_frame(self._order[view.name] * self._frames // len(self._order))
        cover, light = see_through(lens, clean, self._pattern)
        added = light + ((1 - cover) * mist)[..., None] * np.array(self._pattern.mist_colour, np.float32)
        return {"D": cover, "F": mist, **{name: added[..., i] for i, name in enumerate(ADDED)}}

    def _key_frame(self, frame: int) -> tuple[LensMap, Plane]:
        if self._held is None or self._held[0] != frame:
            pattern, camera = self._pattern, self.camera
            moment = frame / max(1, self._frames - 1)
            lens = map_lens(pattern, drops_on(pattern, camera.width, camera.height, moment), camera)
            self._held = frame, lens, mist_cover(pattern, camera.width, camera.height, moment)
        return self._held[1:]
