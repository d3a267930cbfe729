"""Blender process: an embedded scene seen by given cameras, as PNG files, depth maps and a point cloud."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from hydroviews.blender.cycles import add_lamp, add_mesh, empty_scene, place_camera, render_positions, render_rgba
from hydroviews.blender.embedded_scenes.embedded import DESIGNS
from hydroviews.blender.embedded_scenes.looks import LOOKS
from hydroviews.blender.embedded_scenes.materials import make_materials
from hydroviews.blender.embedded_scenes.pieces import Design, Piece
from hydroviews.blender.embedded_scenes.sky import add_sky
from hydroviews.blender.process import Report
from hydroviews.files.atomic import replacing
from hydroviews.scene.cameras import Camera
from hydroviews.scene.depth import FOLDER, write_depth
from hydroviews.scene.images import read_image, to_srgb, to_uint8, write_png

POINTS = 16000
POINT_VIEWS = 12  # the most views that points are taken from


def main(request: dict[str, Any], report: Report) -> None:
    """Render the views that are not there yet, then depth maps and points.

    Args:
        request: "scene", "folder", "seed", "views": [{"name", and the fields of Camera}].
        report: told of the views done.
    """
    folder, seed = Path(request["folder"]), request["seed"]
    cameras = {view.pop("name"): Camera(**view) for view in request["views"]}
    scene = _scene(DESIGNS[request["scene"]], seed)
    total = len(cameras) + 1
    for done, (name, camera) in enumerate(cameras.items()):
        report(done, total)
        path = folder / "images" / f"{name}.png"
        if not path.exists():
            place_camera(scene, camera)
            write_png(path, to_srgb(render_rgba(scene)[..., :3]))
    report(total - 1, total)
    positions, colours = _surfaces(scene, folder, cameras, np.random.default_rng(seed))
    with replacing(folder / "points.npz") as temporary:
        np.savez_compressed(temporary, positions=positions, colours=colours)
    report(total, total)


def _scene(design: Design, seed: int) -> bpy.types.Scene:
    scene = empty_scene(seed)
    shapes, looks, sky = np.random.default_rng(seed).spawn(3)
    things = list(design.make(shapes))
    pieces = [thing for thing in things if isinstance(thing, Piece)]
    materials = make_materials(looks, (piece.material for piece in pieces))
    for piece in pieces:
        item = add_mesh(scene, piece.name, piece.mesh, materials[piece.material])
        item.matrix_world = Matrix.Translation(piece.position) @ Matrix.Rotation(piece.turn, 4, "Z")
        item.visible_shadow = not LOOKS[piece.material].emission  # the lamp may be inside of what glows
    lamps = [thing for thing in things if not isinstance(thing, Piece)]
    for lamp in lamps:
        add_lamp(scene, lamp)
    add_sky(scene, design.sky, sky)
    _set_quality(scene.cycles, design, len(lamps))
    return scene


def _set_quality(cycles: Any, design: Design, n_lamps: int) -> None:
    cycles.samples = design.samples
    cycles.use_light_tree = n_lamps > 0  # pays from the second light on
    cycles.use_denoising = True
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    cycles.denoising_prefilter = "FAST"
    cycles.diffuse_bounces, cycles.glossy_bounces = design.diffuse_bounces, 2
    cycles.max_bounces = max(3, design.diffuse_bounces)
    cycles.sample_clamp_indirect = 3.0  # no fireflies


def _surfaces(
    scene: bpy.types.Scene, folder: Path, cameras: dict[str, Camera], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Write every view's depth; points at random pixels of evenly chosen views, with those pixels' colours."""
    chosen = list(cameras)[:: -(-len(cameras) // POINT_VIEWS)]
    positions, colours = [], []
    for name, camera in cameras.items():
        place_camera(scene, camera)
        surface = render_positions(scene)
        write_depth(folder / FOLDER / f"{name}.exr", _depth(camera, surface))
        if name not in chosen:
            continue
        pixels = rng.permutation(np.flatnonzero(np.isfinite(surface[..., 0])))[: POINTS // len(chosen)]
        positions.append(surface.reshape(-1, 3)[pixels].astype(np.float64))
        image = to_uint8(read_image(folder / "images" / f"{name}.png"))
        colours.append(image.reshape(-1, 3)[pixels])
    return np.concatenate(positions), np.concatenate(colours)


def _depth(camera: Camera, surface: NDArray[np.float32]) -> NDArray[np.float64]:
    """Metres along the optical axis [H, W], infinite where there is only sky."""
    _, depth = camera.project(surface.reshape(-1, 3))
    return np.where(np.isfinite(depth), depth, np.inf).reshape(surface.shape[:2])
