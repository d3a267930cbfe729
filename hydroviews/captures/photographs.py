"""Photographs that cameras are estimated for: what is wrong with them, where they are, room on the disk."""

import logging
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hydroviews.captures.sfm.mapping import DATABASE
from hydroviews.captures.sfm.poses import SETTINGS
from hydroviews.captures.sfm.sources import link_names, link_photographs
from hydroviews.errors import InputError
from hydroviews.files.atomic import listing
from hydroviews.files.full_disk import FullDisk, plain_full_disk
from hydroviews.files.settings_guard import has_settings
from hydroviews.formats.photographs import not_read, photographs_below, require_permission, some
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

NOT_IN_COLMAP = (".webp",)  # formats read everywhere else
NEEDED = 1_000_000  # bytes of the database for a photograph: up to 4096 features, and their matches


def check_photographs(images: Path, out: Path) -> None:
    """Refuse what `require_registrable` does, and warn of photographs that will be left out."""
    require_registrable(images, out)
    if images.is_dir() and (left_out := not_read(images)):
        logger.warning("%s: %s", images, left_out)


def require_registrable(images: Path, out: Path) -> None:
    """Refuse photographs that `estimate_poses` cannot take.

    Args:
        images: folder of the photographs and of folders with more; it need not exist.
        out: folder of the capture. Links to the photographs go to its `images`.

    Raises:
        InputError: formats that COLMAP does not read, or a photograph without permission to; or `images` is that of
            `out`, and links would have other names than the photographs that lie beside them.
    """
    if not images.is_dir():
        return
    sources = photographs_below(images)
    for path in sources:
        require_permission(path)
    foreign = [path.name for path in sources if path.suffix.lower() in NOT_IN_COLMAP]
    if foreign:
        raise InputError(
            f"{images}: photographs that COLMAP does not read", found=some(foreign), fix="convert them to .png or .jpg"
        )
    if images.resolve() == (out / "images").resolve():
        renamed = [str(path) for name, path in link_names(images, sources).items() if path != images / name]
        if renamed:
            raise InputError(
                f"{out}: links without blanks and folders in their names would lie among the photographs",
                found=some(renamed),
                fix="choose another --out",
            )


def renew_links(images: Path, out: Path) -> None:
    """Let a capture's links to photographs lead to where these are now, where they were moved.

    Other photographs than its own are left for `estimate_poses` to refuse.

    Args:
        images: folder of the photographs and of folders with more; it need not exist.
        out: folder of the capture.

    Raises:
        InputError: a photograph cannot be read.
    """
    sources = photographs_below(images) if images.is_dir() else []
    if (out / SETTINGS).is_file() and has_settings(out / SETTINGS, {"files": listing(sources)}):
        places = {name: (out / "images" / name, path) for name, path in link_names(images, sources).items()}
        broken = {name: path for name, (link, path) in places.items() if link.is_symlink() and not link.exists()}
        link_photographs(broken, out / "images", turned=False)


def without_camera(scene: Scene, images: Path) -> list[str]:
    """Names of the photographs in the folder `images` that are no view's."""
    used = {view.path for view in scene.views}
    return [path.relative_to(images).as_posix() for path in photographs_below(images) if path not in used]


def camera_notes(scene: Scene, images: Path) -> list[str]:
    """A sentence that names the photographs in the folder `images` without a camera; none where each has one."""
    names = without_camera(scene, images)
    return [f"without a camera, and left out: {some(names)}"] if names else []


@contextmanager
def room_for(out: Path, photographs: int) -> Iterator[None]:
    """Refuse a disk without room for the cameras or points of photographs, and say so where it fills up in the block.

    pycolmap ends the process where threads of its own find the disk full, so it is looked at first.

    Args:
        out: where the database of features goes; it need not exist.
        photographs: how many.

    Raises:
        FullDisk: there is less room than these will take.
    """
    with plain_full_disk(out / DATABASE):
        needed = photographs * NEEDED - sum(path.stat().st_size for path in out.glob(f"{DATABASE}*") if path.is_file())
        free = shutil.disk_usage(next(place for place in (out, *out.parents) if place.exists())).free
        if free < needed and not (out / "sparse").is_dir():
            raise FullDisk(
                f"{out}: no space left on the disk for {photographs} photographs",
                found=f"{free / 1e9:.2f} GB",
                expected=f"at least {needed / 1e9:.2f} GB more",
                fix="free some space and run the same command again",
            )
        yield
