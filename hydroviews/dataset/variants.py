"""Opens what `build` wrote: the clean views of a scene, or one of its rainy variants."""

from dataclasses import replace
from pathlib import Path

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.colmap import read_colmap
from hydroviews.scene.scenes import Scene


def open_clean(folder: Path) -> Scene:
    """The clean views of a built scene, with its split.

    Raises:
        InputError: there are none, since it rained when the scene was captured; or it was not built.
    """
    if is_captured(folder):
        raise InputError(
            f"{folder}: taken in rain, there are no clean views",
            fix=f"use what needs none, such as METHOD=3dgs, and open its photographs as the variant {CAPTURED}",
        )
    return _open(folder, folder, CLEAN)


def open_variant(folder: Path, pattern: str) -> Scene:
    """The rainy views of a built scene; cameras, points, split and masks are the clean ones."""
    return _open(folder, folder / pattern, "images")


def is_captured(folder: Path) -> bool:
    """Whether a built scene was captured in rain, so that CAPTURED is all there is to see of it."""
    return (folder / CAPTURED).is_dir()


def _open(scene: Path, project: Path, images: str) -> Scene:
    if not (project / images).is_dir():
        raise InputError(f"{project / images}: no such views", fix="build the scene with this pattern first")
    return replace(read_colmap(project, scene.name, images), captured_rainy=is_captured(scene))
