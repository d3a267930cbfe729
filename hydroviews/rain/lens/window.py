"""A wet window pane as an effect: thousands of small drops in focus, water film, runs, and mist that comes in patches.

    rainy = (1 - M) (1 - V) B' + D + (1 - M) V air        in linear light

B' is the clean view, blurred where mist is thick. Unlike the drops of `raindrop`, those of a pane show mostly light of
their own (`optics.own_light`), as the paper's equation takes D as given.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np

from hydroviews.rain.compositing import WATER, Layers, water_over
from hydroviews.rain.effect import Effect
from hydroviews.rain.lens.optics.own_light import OwnLight, tilted
from hydroviews.rain.lens.optics.path_matte import PathMatte
from hydroviews.rain.lens.patterns.mist import window_mist
from hydroviews.rain.lens.patterns.pattern import fitted_to
from hydroviews.rain.lens.patterns.window import WindowPattern, draw_window
from hydroviews.rain.lens.raindrops import Plane, PreparedLens, Raindrops
from hydroviews.rain.lens.window_severity import grade_window, lit_by
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear, to_srgb


class WindowEffect(Effect):
    """`window`: M is cover by water, V by mist; Blender bakes the water for every size and focal length."""

    planes = WATER
    needs_optics = True
    needed = ("mist_blur",)
    renewed: ClassVar[float] = 0.0  # share of the water that is new in every view, 0 to 1
    words: ClassVar[Mapping[str, str]] = {
        "kind": "a {} pane",
        "droplets": "{} beads",
        "coverage": "larger drops over {:.1%} of the picture",
        "film": "bands of water film: {}",
        "rivulets": "runs: {}",
        "mist": "mist that hides {:.0%} where it is densest",
        "own_light": "drops with {:.0%} of light of their own",
        "tilt": "tilted by a disk of {:.2f} picture sides",
        "key_frames": "a sequence of {} key frames",
        "lens_renderer": "drawn by {}",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> WindowPattern:
        """A pane in rain of the grade; its beads and its mist are set by the scene."""
        rng = pattern_generator(pattern, statistics)
        drawn = lit_by(draw_window(rng, pattern.level), rng, statistics)
        pane = replace(fitted_to(drawn, statistics), renewed=self.renewed)
        return grade_window(pane, pattern.grade, statistics)

    def place(self, drawn: WindowPattern, pattern: Pattern, statistics: SceneStatistics) -> "Window":
        """The pane in front of the scene, whose air lights the mist."""
        return Window(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See the module; the blur follows V, `mist_blur` sides where V is 1."""
        behind = behind_mist(to_linear(clean), layers["V"], parameters["mist_blur"])
        return to_srgb(water_over(behind, layers))


def behind_mist(light: Image, veil: Plane, blur: float) -> Image:
    """A picture [H, W, 3] blurred in proportion to a veil [H, W], by `blur` sides (standard deviation) where it is 1.

    Two blurred copies and the picture itself are mixed, pixel by pixel.
    """
    sigma = blur * float(np.sqrt(light.shape[0] * light.shape[1]))
    if sigma == 0 or not veil.any():
        return light
    some, most = (cv2.GaussianBlur(light, (0, 0), share * sigma, borderType=cv2.BORDER_REFLECT) for share in (0.5, 1))
    low, high = np.clip(2 * veil, 0, 1)[..., None], np.clip(2 * veil - 1, 0, 1)[..., None]
    return np.asarray(light + low * (some - light) + high * (most - some), np.float32)


class Window(Raindrops):
    """A pane on one scene."""

    def __init__(self, pattern: WindowPattern, statistics: SceneStatistics) -> None:
        super().__init__(pattern, statistics)
        self._pane = pattern

    def prepare(self, camera: Camera, folder: Path) -> "PreparedWindow":
        """The pane for views of this size and these intrinsics; mattes that Blender bakes are kept in `folder`."""
        air = np.array(self.parameters["air_light"], np.float32)
        return PreparedWindow(self._pane, air, [view.name for view in self._views], camera, folder)


class PreparedWindow(PreparedLens):
    """Water on a pane in front of one camera; drops without light of the scene are the same for a whole key frame."""

    def __init__(self, pattern: WindowPattern, air: Plane, views: list[str], camera: Camera, folder: Path) -> None:
        """Bake nothing yet; arguments as for `PreparedLens`."""
        super().__init__(pattern, air, views, camera, folder)
        self._pane = pattern
        self._own = OwnLight(pattern, camera.width, camera.height)
        self._lit: tuple[int, Plane, Plane] | None = None  # key frame, cover and own light of water that stays

    def _veil(self, moment: float) -> Plane:
        return window_mist(self._pane, self._camera.width, self._camera.height, moment)

    def _drops(self, light: Image, matte: PathMatte | None, frame: int, number: int) -> tuple[Plane, Plane]:
        """Cover [H, W] and linear radiance [H, W, 3]; of renewed water both are new in every view."""
        own = self._pane.own_light
        if self._renewed is not None:
            painter = self._renewed.painted(light, number)
            mask, lit = self._shown(painter.mask, painter.sky)
            return mask, own * lit + (1 - own) * tilted([painter.radiance], self._pane)[0]
        if matte is None or matte.sky is None:
            raise ValueError("a window needs a matte with own light")
        if self._lit is None or self._lit[0] != frame:
            self._lit = (frame, *self._shown(matte.mask, matte.sky))
        _, mask, lit = self._lit
        if own == 1:
            return mask, lit
        return mask, own * lit + (1 - own) * tilted([matte.apply(light)], self._pane)[0]

    def _shown(self, mask: Plane, sky: Plane) -> tuple[Plane, Plane]:
        mask, lit = tilted([mask, self._own.radiance(mask, sky)], self._pane)
        return np.clip(mask, 0, 1), lit
