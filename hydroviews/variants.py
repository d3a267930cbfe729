"""Opens what `build` wrote: the clean views of a scene, or one of its rainy variants."""

from pathlib import Path

from hydroviews.build import CLEAN
from hydroviews.errors import InputError
from hydroviews.readers.colmap import read_colmap
from hydroviews.scenes import Scene


def open_clean(folder: Path) -> Scene:
    """The clean views of a built scene, with its split."""
    return _open(folder, folder, CLEAN)


def open_variant(folder: Path, pattern: str) -> Scene:
    """The rainy views of a built scene; cameras, points and split are the clean ones."""
    return _open(folder, folder / pattern, "images")


def _open(scene: Path, project: Path, images: str) -> Scene:
    if not (project / images).is_dir():
        raise InputError(f"{project / images}: no such views", fix="build the scene with this pattern first")
    return read_colmap(project, scene.name, images)
