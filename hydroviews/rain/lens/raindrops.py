"""Water on the lens: drops and mist that stay there, and slowly change, from view to view."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.optics.bake import aperture_radius, bake_matte, focus_disk, lens_water, moment_of, trace
from hydroviews.rain.lens.optics.path_matte import PathMatte, defocus
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.lens.renewed import RenewedDrops
from hydroviews.rain.light import expand_highlights
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear
from hydroviews.scene.scenes import View

Plane = NDArray[np.float32]
TRACED_SAMPLES = 384  # paths a pixel of the renderer "traced"


class Raindrops:
    """A pattern on one scene."""

    def __init__(self, pattern: RaindropPattern, statistics: SceneStatistics) -> None:
        air = np.array(statistics.light.air) * pattern.air
        self.parameters: dict[str, Any] = {**asdict(pattern), "air_light": [round(float(v), 6) for v in air]}
        self._pattern, self._views = pattern, statistics.views

    def prepare(self, camera: Camera, folder: Path) -> "PreparedLens":
        """The lens for views of this size and these intrinsics; mattes that Blender bakes are kept in `folder`."""
        air = np.array(self.parameters["air_light"], np.float32)
        return PreparedLens(self._pattern, air, [view.name for view in self._views], camera, folder)


class PreparedLens:
    """Water in front of one camera, as it slowly changes from view to view.

    With n views in order of name and K key frames, view i shows key frame floor(i K / n). A key frame is baked when the
    first view needs it, and kept on disk; one is held in memory. Where a share of the drops is renewed, `renewed` draws
    them, and key frames are those of the mist.
    """

    def __init__(
        self, pattern: RaindropPattern, air: Plane, views: Sequence[str], camera: Camera, folder: Path
    ) -> None:
        """Bake nothing yet.

        Args:
            pattern: what is on the lens.
            air: the light [3] that mist scatters, linear.
            views: names of all views of the scene, in order.
            camera: its size and intrinsics.
            folder: keeps the mattes.
        """
        self._pattern, self._air = pattern, air
        self._numbers = {name: i for i, name in enumerate(views)}
        self._camera, self._folder = camera, folder
        self._disk = focus_disk(pattern, camera)
        self._renewed = RenewedDrops(pattern, camera, folder, len(views)) if pattern.renewed > 0 else None
        self._held: tuple[int, PathMatte | None, Plane] | None = None

    def layers(self, clean: Image, view: View) -> dict[str, Plane]:
        """What lies over a view.

        Args:
            clean: [H, W, 3], sRGB-encoded, of the camera's size.
            view: one of the scene's.

        Returns:
            Planes [H, W]: M, cover by drops; V, by mist; R, G, B, the linear radiance of both, so that the rainy
            view is (1 - M) (1 - V) B + (R, G, B) in linear light, B blurred where the lens is focused on the drops. It
            may exceed 1 where lamps shine through drops.

        Raises:
            InputError: Blender failed (see `process.run_blender`).
        """
        number = self._numbers[view.name]
        frame = number * self._pattern.key_frames // len(self._numbers)
        matte, veil = self._key_frame(frame)
        light = expand_highlights(to_linear(clean))
        if self._pattern.focus == "drops" and self._pattern.lens_renderer == "disk":
            light = defocus(light, self._disk)  # what a drop in focus shows is out of focus as the scene is
        mask, drops = self._drops(light, matte, frame, number)
        radiance = drops + ((1 - mask) * veil)[..., None] * self._air
        return {"M": mask, "V": veil, **{channel: radiance[..., i] for i, channel in enumerate("RGB")}}

    def _key_frame(self, frame: int) -> tuple[PathMatte | None, Plane]:
        if self._held is None or self._held[0] != frame:
            pattern, camera = self._pattern, self._camera
            baked = pattern.lens_renderer != "traced" and self._renewed is None
            matte = bake_matte(pattern, camera, self._folder, frame) if baked else None
            self._held = frame, matte, self._veil(moment_of(pattern, frame))
        return self._held[1:]

    def _veil(self, moment: float) -> Plane:
        """V [H, W] at a moment, 0 at the first view, 1 at the last."""
        return mist_veil(self._pattern, self._camera.width, self._camera.height, moment)

    def _drops(self, light: Image, matte: PathMatte | None, frame: int, number: int) -> tuple[Plane, Plane]:
        """Cover [H, W] and linear radiance [H, W, 3] of the drops in front of a picture of linear light."""
        if self._renewed is not None:
            painter = self._renewed.painted(light, number)
            blurred = self._pattern.focus == "scene" and self._pattern.lens_renderer == "disk"
            disk = self._disk if blurred else 0.0
            return np.clip(defocus(painter.mask, disk), 0, 1), defocus(painter.radiance, disk)
        if matte is not None:
            return matte.mask, matte.apply(light)
        opening = aperture_radius(self._disk, self._camera)
        mesh = lens_water(self._pattern, self._camera, frame)
        samples, focus = TRACED_SAMPLES, self._pattern.focus
        traced, _ = trace(mesh, self._camera, light, samples, self._folder, opening, seed=frame, focus=focus)
        return np.clip(traced[..., 3], 0, 1), traced[..., :3]
