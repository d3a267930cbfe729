"""Your own rainy photographs or video to a clean 3D scene: cameras, training, a splat file, a film, pictures."""

import logging
import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import tyro

from baselines.method import Method, find_method
from baselines.rendering.film import FilmChoice, draw_film
from baselines.splatting.files.ply import SPLATS
from baselines.training.devices import warn_of_slow_profile
from hydroviews.captures.enhancer import find_enhancer
from hydroviews.captures.photographs import camera_notes, require_registrable
from hydroviews.captures.sfm.poses import estimate_poses, triangulate
from hydroviews.captures.video.capture import capture_video
from hydroviews.captures.video.decoding import open_video
from hydroviews.captures.video.frames import FrameChoice
from hydroviews.dataset.card.contact_sheet import spread
from hydroviews.dataset.clean_views import TOO_FEW, triangulated
from hydroviews.dataset.manifest import require_outside_scenes
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import read_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.settings_guard import claim_folder
from hydroviews.files.temporary import remove_tree
from hydroviews.formats.colmap import reliable
from hydroviews.formats.colmap_format import read_points
from hydroviews.formats.mask_files.hidden_share import scene_hidden_notes
from hydroviews.formats.photographs import photographs_below, unreadable_photographs
from hydroviews.formats.read import has_cameras, read_scene
from hydroviews.formats.writers import write_colmap
from hydroviews.profiles import find_profile, require_seed
from hydroviews.scene.images import SUFFIXES, write_png
from hydroviews.scene.photograph_damage import require_whole
from hydroviews.scene.picture_grid import Canvas, Row, Tile, draw_sheet
from hydroviews.scene.scenes import Scene, Split

logger = logging.getLogger(__name__)

CAPTURE, TRAINING, FILM, SHEET, SETTINGS = "capture", "training", "film.mp4", "views.png", "reconstruction.json"
POINTS = "points"  # in CAPTURE, of a capture that came without
SHOWN = 4  # photographs on the sheet
SHEET_WIDTH = 1600  # pixels


@dataclass(frozen=True)
class Reconstruction:
    """Input and settings of a reconstruction."""

    photographs: tyro.conf.Positional[Path]  # folder of photographs, capture with cameras, or video
    out: Path | None = None  # output folder. Default: `<photographs>-scene` beside the photographs
    method: str = "deraings-plus"  # any method of the benchmark that trains on rainy views
    profile: str = "standard"  # image size and length of the training: demo, standard or paper
    long_side: int | None = None  # longer side of the images in pixels. Default: the profile's
    rate: float = 1.0  # frames per second of a video
    seed: int = 0
    film: FilmChoice = field(default_factory=FilmChoice)

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        path = self.photographs.resolve()
        name = path.name if path.is_dir() else path.stem
        return self.out or path.with_name(name + "-scene")


def reconstruct(request: Reconstruction) -> Path:
    """Photographs to a scene; after an interruption the same call resumes, with the cameras and steps that are done.

    All photographs are learned from, none is held out. The folder gets `capture` (photographs and cameras, or points
    for a capture that has cameras alone), `training` (the model, and `splats.ply` where it is one of Gaussians),
    `views.png` (photographs beside renders) and `film.mp4`.

    Returns:
        The folder.

    Raises:
        InputError: nothing to reconstruct from, too few photographs register, settings that cannot be, or the folder
            holds a reconstruction with others.
    """
    method, folder = checked_method(request), request.folder
    with locked(folder.resolve(), BUSY):
        claim_folder(
            folder / SETTINGS,
            recorded_settings(request),
            taken="holds a reconstruction with other settings",
            foreign="holds other files",
            fix="choose another --out, or remove the folder",
            ignored=may_differ(folder / SETTINGS),
        )
        warn_of_slow_profile(request.profile)
        scene = find_scene(request, folder / CAPTURE)
        for note in (*scene.notes, *_left_out(scene, request)):
            logger.info(note)
        scene = all_views(scene.resized(request.long_side or find_profile(request.profile).long_side))
        for note in scene_hidden_notes(scene):
            logger.warning(note)
        method.fit(scene, folder / TRAINING)
        method.save(folder / TRAINING)
        show(method, scene, request)
    return folder


def reconstruct_command(request: tyro.conf.OmitArgPrefixes[Reconstruction]) -> None:
    """Reconstruct a clean 3D scene from rainy photographs or a rainy video: cameras, splats.ply, film, pictures."""
    reconstruct(request)


def checked_method(request: Reconstruction) -> Method:
    """The method that is to learn, before its folder is claimed and hours are spent on cameras.

    Raises:
        InputError: nothing to reconstruct from, a folder among the photographs, or settings that cannot be.
    """
    require_photographs(request.photographs)
    require_outside(request)
    kind = find_method(request.method)
    if kind.trains_on != "rainy":
        raise InputError(
            f"--method {request.method}: learns from clean views, and there are none",
            fix="choose a method that trains on rainy views",
        )
    FrameChoice(request.rate, request.long_side)
    require_seed(request.seed)
    return kind(kind.configuration(request.profile), request.seed)


def show(method: Method, scene: Scene, request: Reconstruction) -> None:
    """Draw photographs beside renders and the film, and say what is where and what was found."""
    folder = request.folder
    write_png(folder / SHEET, compared(method, scene, request.photographs.resolve().stem))
    settings = {name: value for name, value in read_json(folder / SETTINGS).items() if name != "film"}
    draw_film(method, scene, folder / FILM, request.film, {"scene": settings}, overwrite=True)
    splats = (folder / TRAINING / SPLATS).is_file()  # methods without Gaussians write none
    model = f"{TRAINING}/{SPLATS} for splat viewers" if splats else f"the model in {TRAINING}"
    logger.info(f"{folder}: {model}, {FILM}, {SHEET}")
    logger.info(f"found in the photographs: {method.summary().used or 'the method does not look for rain'}")


def recorded_settings(request: Reconstruction) -> dict[str, Any]:
    """The settings on which a reconstruction depends, for JSON: not its folder, nor the rate where there is no film."""
    settings = asdict(request) | {"photographs": str(request.photographs.resolve())}
    del settings["out"]
    if request.photographs.is_dir():
        del settings["rate"]
    return settings


def may_differ(settings: Path) -> tuple[str, ...]:
    """Names of recorded settings that may differ: where the photographs are among them if they are no longer there.

    Where cameras, frames and training are kept it is checked that those elsewhere are the same.
    """
    earlier = read_json(settings) if settings.is_file() else {}
    moved = isinstance(earlier, dict) and not os.path.exists(str(earlier.get("photographs")))
    return ("film", "photographs") if moved else ("film",)


def require_photographs(path: Path) -> None:
    """Refuse a path without photographs before a folder is made for it; log which photographs cannot be read.

    Raises:
        InputError: the path is neither a film that opens, nor a capture with cameras, nor a folder of photographs, or
            one of these is a damaged JPEG.
    """
    if path.is_file():
        with open_video(path):
            return
    if path.is_dir() and has_cameras(path):
        return
    other = unreadable_photographs(path) if path.is_dir() else ""
    if path.is_dir() and photographs_below(path):
        require_whole(photographs_below(path), "looking for damage")
        if other:
            logger.info(f"{path}: {other} left out, as only {', '.join(SUFFIXES)} are read")
        return
    raise InputError(
        f"{path}: nothing to reconstruct from",
        found=(other or "no photographs in it") if path.is_dir() else "no such file or folder",
        expected=f"a folder of photographs ({', '.join(SUFFIXES)}), a capture with cameras, or a video",
        fix="convert them, to JPEG for instance" if other else None,
    )


def require_outside(request: Reconstruction) -> None:
    """Refuse to write among the photographs: pictures there would be read as photographs the next time.

    Raises:
        InputError: the folder to write to lies in that of the photographs, or in a built scene.
    """
    require_outside_scenes(request.folder)
    folder, photographs = request.folder.resolve(), request.photographs.resolve()
    if photographs.is_dir() and folder.is_relative_to(photographs):
        raise InputError(
            f"--out {folder}: among the photographs",
            found=f"a folder in {photographs}",
            expected="one beside it",
            fix="choose another --out",
        )


def find_scene(request: Reconstruction, capture: Path) -> Scene:
    """The photographs with cameras, estimated into `capture` if they have none.

    Raises:
        InputError: too few photographs register, a damaged photograph, or a film or camera file that cannot be read.
    """
    path = request.photographs
    if path.is_file():
        scene = capture_video(path, capture, FrameChoice(request.rate), seed=request.seed, enhance=find_enhancer())
        return cast(Scene, scene)  # None only where it is to stop before cameras
    if has_cameras(path):
        scene = read_scene(path)
        require_whole([view.path for view in scene.views], "looking for damage")
        return with_points(scene, capture / POINTS)
    require_registrable(path, capture)
    return estimate_poses(path, capture, seed=request.seed, rainy=True, enhance=find_enhancer())


def _left_out(scene: Scene, request: Reconstruction) -> list[str]:
    """Sentences on photographs without a camera; of a film the scene's own notes tell."""
    return camera_notes(scene, request.folder / CAPTURE / "images") if request.photographs.is_dir() else []


def with_points(scene: Scene, folder: Path) -> Scene:
    """The scene; where it has hardly any points, with some that are triangulated once and kept in `folder`.

    Raises:
        InputError: an unreadable photograph, or a full disk.
    """
    if len(scene.points) >= TOO_FEW:
        return scene
    if not folder.is_dir():
        work = folder.with_name(".triangulation")
        ownership.enter_all([f"{work.name}/"], work.parent)
        found = triangulate(scene, work)
        write_colmap(replace(scene, points=found), folder)
        remove_tree(work)
    points = reliable(read_points(folder))
    if len(points) <= len(scene.points):
        return scene if len(scene.points) else replace(scene, notes=(*scene.notes, triangulated(0)))
    return replace(scene, points=points, notes=(*scene.notes, triangulated(len(points), len(scene.points))))


def all_views(scene: Scene) -> Scene:
    """The scene with nothing held out: all photographs are for training."""
    names = tuple(view.name for view in scene.views)
    return replace(scene, split=Split(names, (), scene.split.sparse))


def compared(method: Method, scene: Scene, title: str) -> Canvas:
    """A sheet of a few photographs, each above what the scene looks like from there."""
    names = spread([view.name for view in scene.views], SHOWN)
    views = [view for view in scene.views if view.name in set(names)]
    rows = [
        Row("photographs", "", [Tile(view.image(), view.name) for view in views]),
        Row("the scene", "from the same places", [Tile(method.render(view.camera)) for view in views]),
    ]
    return draw_sheet(title, f"{len(scene.views)} photographs", rows, SHEET_WIDTH)
