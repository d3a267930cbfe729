"""A lens of which a share of the drops is new in every view, drawn from a bank of baked lenses.

The bank's lenses have the pattern's distributions and seeds of their own, and reach beyond the picture by as much as
drops may be moved. Which drops are there in a view is drawn in `lives`; each grows with its age as key frames say.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from hydroviews.rain.lens.lives import LENSES, SHIFT, draw_lives
from hydroviews.rain.lens.optics.bake import (
    COMPOSITED,
    VERSION,
    accurate_passes,
    aperture_radius,
    bake_paths,
    focus_disk,
    intrinsics,
    paths_per_side,
    sky_edge,
    water_of,
)
from hydroviews.rain.lens.optics.drop_bank import DropBank, DropPainter, cut
from hydroviews.rain.lens.optics.mesh import lens_side, water_mesh
from hydroviews.rain.lens.patterns.bodies import Bodies, bodies_of, nearest_disk, same_bodies
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.seeds import generator


class RenewedDrops:
    """The drops in front of a capture's views; a lens of the bank is baked when a view first needs it, and kept."""

    def __init__(self, pattern: RaindropPattern, camera: Camera, folder: Path, views: int) -> None:
        """Bake nothing yet.

        Args:
            pattern: what is on the lens.
            camera: its size and intrinsics.
            folder: keeps baked lenses.
            views: how many the capture has.
        """
        self._pattern, self._camera, self._folder, self._views = pattern, camera, folder, views
        self._lenses = [BankLens.of(pattern, camera, number) for number in range(LENSES)]
        sides = (camera.width / lens_side(camera), camera.height / lens_side(camera))
        self._lives = draw_lives(pattern, [lens.bodies(camera) for lens in self._lenses], sides, views)
        self._held: dict[tuple[int, int], DropBank] = {}

    def painted(self, light: Image, view: int) -> DropPainter:
        """Drops of a view, by number, in focus: cover, radiance, and the bright part of a window's own light.

        Raises:
            InputError: Blender failed, or a kept lens is damaged.
        """
        painter = DropPainter(light)
        for born in self._lives.at(view):
            frame = (view - born.birth) * self._pattern.key_frames // self._views
            shift = (round(born.shift[0] * self._camera.width), round(born.shift[1] * self._camera.height))
            painter.paint(self._lens(born.lens, frame), born.slots, shift)
        return painter

    def _lens(self, number: int, frame: int) -> DropBank:
        if (number, frame) not in self._held:
            kept = self._folder / f"drops-{number}-{frame}.npz"
            self._held[number, frame] = self._lenses[number].baked(frame, self._pattern, self._camera, kept)
        return self._held[number, frame]


@dataclass(frozen=True, eq=False)
class BankLens:
    """A lens of the bank, with a margin around the picture."""

    pattern: RaindropPattern  # whose sides are those of `canvas`
    canvas: Camera
    margin: tuple[int, int]  # columns to the left and right, rows above and below

    @classmethod
    def of(cls, pattern: RaindropPattern, camera: Camera, number: int) -> "BankLens":
        """The lens of that number."""
        across, down = round(SHIFT * camera.width), round(SHIFT * camera.height)
        size = (camera.width + 2 * across, camera.height + 2 * down)
        canvas = replace(camera, width=size[0], height=size[1], cx=camera.cx + across, cy=camera.cy + down)
        shrink = lens_side(camera) / lens_side(canvas)
        wider = replace(
            pattern,
            seed=int(generator(pattern.seed, "bank", number).integers(2**31)),
            radius_median=shrink * pattern.radius_median,
            droplet_median=shrink * pattern.droplet_median,
            capillary_length=shrink * pattern.capillary_length,
            droplets=round(pattern.droplets / shrink**2),
        )
        return cls(wider, canvas, (across, down))

    def bodies(self, camera: Camera) -> Bodies:
        """Its water at first, in sides of the picture from the picture's upper left corner."""
        first = bodies_of(water_of(self.pattern, self.canvas, 0))
        scale, side = lens_side(self.canvas) / lens_side(camera), lens_side(camera)
        disks = first.disks * scale - np.array([self.margin[0] / side, self.margin[1] / side, 0.0])
        return replace(first, disks=disks)

    def baked(self, frame: int, pattern: RaindropPattern, camera: Camera, kept: Path) -> DropBank:
        """Its drops at a key frame, read from `kept` if that fits.

        Args:
            frame: 0 to `pattern.key_frames` - 1.
            pattern: what was drawn.
            camera: of the views.
            kept: an npz file; Blender's log goes beside it.

        Raises:
            InputError: Blender failed, or the kept file is damaged.
        """
        paths, aperture = paths_per_side(camera), pattern.lens_renderer == "aperture"
        passes = accurate_passes(paths) if aperture else 1
        drawn = {name: value for name, value in asdict(self.pattern).items() if name not in COMPOSITED}
        key = json.dumps([VERSION, drawn, intrinsics(self.canvas), [frame, paths, passes]])
        if kept.exists():
            bank, kept_key = DropBank.load(kept)
            if kept_key == key:
                return bank
        first, water = (water_of(self.pattern, self.canvas, moment) for moment in (0, frame))
        bodies, now = bodies_of(first), bodies_of(water)
        slots, owners, side = same_bodies(water, bodies, now), now.owners, lens_side(self.canvas)
        opening = aperture_radius(focus_disk(pattern, camera), camera) if aperture else 0.0
        mesh = water_mesh(water, self.pattern.capillary_length, self.canvas)
        traced = bake_paths(mesh, self.canvas, kept.parent, paths, passes, opening, pattern.focus)
        edge = sky_edge(self.pattern, self.canvas)
        bright = None if edge is None else edge.plane(traced)
        bank = cut(
            traced, self.margin, len(bodies), lambda at: slots[owners[nearest_disk(at / side, now.disks)]], bright
        )
        bank.save(kept, key)
        return bank
