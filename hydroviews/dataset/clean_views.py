"""What all variants of a built scene share: views at their final size, masks, depth, cameras, points and split."""

import logging
from dataclasses import asdict, replace
from pathlib import Path

from tqdm import tqdm

from hydroviews.captures.sfm.poses import triangulate
from hydroviews.files import ownership
from hydroviews.files.atomic import write_json
from hydroviews.files.temporary import remove_tree
from hydroviews.formats.colmap import reliable
from hydroviews.formats.colmap_format import read_points
from hydroviews.formats.writers import write_colmap, write_nerfstudio
from hydroviews.scene.depth import FOLDER as DEPTH
from hydroviews.scene.depth import depth_path, filled_depth, write_depth
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import MASKS, mask_name
from hydroviews.scene.photograph_damage import require_whole
from hydroviews.scene.scenes import Points, Scene, View

logger = logging.getLogger(__name__)

CLEAN = "clean"
WORK = ".triangulation"
FEW_POINTS = 100  # of a capture whose poses may be wrong
TOO_FEW = 40  # below which points of a capture are not enough to begin with


def write_views(scene: Scene, folder: Path, images: str) -> Scene:
    """Write the views, and what masks hide of them, at their final size; returns the scene that reads from them.

    Clean photographs of a scene that was captured in rain go to `clean`.

    Raises:
        InputError: a photograph or a mask is unreadable, damaged, or of another shape than its camera.
    """
    masked = any(view.mask for view in scene.views)
    kept = [(CLEAN, view) for view in scene.clean_views] + [(images, view) for view in scene.own_views]
    missing = [view.path for where, view in kept if not (folder / where / f"{view.name}.png").is_file()]
    require_whole(missing, f"{scene.name}: looking for damage")
    built: dict[str, dict[str, View]] = {CLEAN: {}, images: {}}
    for where, view in tqdm(kept, desc=f"{scene.name}: {images.partition('/')[0]} views", unit="view"):
        path = folder / where / f"{view.name}.png"
        if not path.is_file():
            write_png(path, view.rounded())
        built[where][view.name] = View(view.name, view.camera, path, mask=_write_mask(view, folder) if masked else None)
        _write_depth(view, built[where][view.name], folder, scene.points)
    views = tuple((built[CLEAN] | built[images])[view.name] for view in scene.views)
    clean = tuple(built[CLEAN][view.name] for view in scene.clean_views)
    distorted = sum(view.lens is not None and depth_path(view).is_file() for view in scene.views)
    notes = [f"{distorted} depth maps left out: their photographs are distorted"] if distorted else []
    return replace(scene, views=views, clean_views=clean, notes=(*scene.notes, *notes))


def _write_mask(view: View, folder: Path) -> Path:
    """Write what is hidden of a view, be it nothing: COLMAP and nerfstudio want masks of all views or of none."""
    path = folder / MASKS / mask_name(f"{view.name}.png")
    if not path.is_file():
        view.write_mask(path)
    return path


def _write_depth(view: View, built: View, folder: Path, points: Points) -> None:
    """Write the view's depth map, if the capture has one that fits: rain in space is hidden behind surfaces."""
    source, path = depth_path(view), folder / DEPTH / f"{view.name}.exr"
    if view.lens is None and source.is_file() and not path.is_file():
        write_depth(path, filled_depth(source, built.camera, points))


def triangulated(count: int, before: int = 0) -> str:
    """A note on the points that a capture did not come with, or came with too few of."""
    few = ", which is few: are these the photographs' cameras, in the axes that the file's format has?"
    instead = f" instead of {before}, which are too few to begin with" if before else ""
    return f"{count} points triangulated from the photographs{instead}{few if count < FEW_POINTS else ''}"


def write_cameras(scene: Scene, folder: Path, capture: Scene, images: str) -> Scene:
    """Write cameras, points and split; a capture with hardly any points gets some from its full-size photographs.

    Returns:
        The scene with the points that were written, and a note on those that were triangulated.
    """
    model = folder / "sparse" / "0"
    if len(scene.points) < TOO_FEW:
        ownership.enter_all([f"{WORK}/"], folder)
        found = reliable(read_points(model)) if model.is_dir() else triangulate(capture, folder / WORK)
        if len(found) > len(scene.points) or not len(scene.points):
            note = triangulated(len(found), len(scene.points))
            logger.info("%s: %s", scene.name, note)
            scene = replace(scene, points=found, notes=(*scene.notes, note))
    if not model.is_dir():
        write_colmap(scene, model)
    remove_tree(folder / WORK)
    write_nerfstudio(scene, folder / "transforms.json", images)
    write_json(folder / "split.json", asdict(scene.split))
    return scene
