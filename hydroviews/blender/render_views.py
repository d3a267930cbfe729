"""Blender process: the courtyard seen by given cameras, as PNG files and a point cloud."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from hydroviews.blender.courtyard import make_courtyard
from hydroviews.blender.cycles import add_mesh, empty_scene, place_camera, render_positions, render_rgba
from hydroviews.blender.materials import make_materials
from hydroviews.blender.process import Report
from hydroviews.blender.sky import add_sky
from hydroviews.cameras import Camera
from hydroviews.files import replacing
from hydroviews.images import read_image, to_srgb, to_uint8, write_png

SAMPLES = 20  # a pixel; what is left of the noise is removed by OpenImageDenoise
POINTS = 16000
POINT_VIEWS = 12  # the most views that points are taken from


def main(request: dict[str, Any], report: Report) -> None:
    """Render the views that are not there yet, then the points.

    Args:
        request: "folder", "seed", "views": [{"name", and the fields of Camera}].
        report: told of the views done.
    """
    folder, seed = Path(request["folder"]), request["seed"]
    cameras = {view.pop("name"): Camera(**view) for view in request["views"]}
    scene = _courtyard_scene(seed)
    total = len(cameras) + 1
    for done, (name, camera) in enumerate(cameras.items()):
        report(done, total)
        path = folder / "images" / f"{name}.png"
        if not path.exists():
            place_camera(scene, camera)
            write_png(path, to_srgb(render_rgba(scene)[..., :3]))
    report(total - 1, total)
    positions, colours = _points(scene, folder, cameras, np.random.default_rng(seed))
    with replacing(folder / "points.npz") as temporary:
        np.savez_compressed(temporary, positions=positions, colours=colours)
    report(total, total)


def _courtyard_scene(seed: int) -> bpy.types.Scene:
    scene = empty_scene(seed)
    shapes, looks, sky = np.random.default_rng(seed).spawn(3)
    materials = make_materials(looks)
    for piece in make_courtyard(shapes):
        item = add_mesh(scene, piece.name, piece.mesh, materials[piece.material])
        item.matrix_world = Matrix.Translation(piece.position) @ Matrix.Rotation(piece.turn, 4, "Z")
    add_sky(scene, sky)
    cycles = scene.cycles
    cycles.samples = SAMPLES
    cycles.use_light_tree = False  # there is only the sun
    cycles.use_denoising = True
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    cycles.denoising_prefilter = "FAST"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 3, 2, 2
    cycles.sample_clamp_indirect = 3.0  # no fireflies
    return scene


def _points(
    scene: bpy.types.Scene, folder: Path, cameras: dict[str, Camera], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Surface points seen at random pixels of evenly chosen views, with those pixels' colours."""
    chosen = list(cameras)[:: -(-len(cameras) // POINT_VIEWS)]
    positions, colours = [], []
    for name in chosen:
        place_camera(scene, cameras[name])
        surface = render_positions(scene)
        pixels = rng.permutation(np.flatnonzero(np.isfinite(surface[..., 0])))[: POINTS // len(chosen)]
        positions.append(surface.reshape(-1, 3)[pixels].astype(np.float64))
        image = to_uint8(read_image(folder / "images" / f"{name}.png"))
        colours.append(image.reshape(-1, 3)[pixels])
    return np.concatenate(positions), np.concatenate(colours)
