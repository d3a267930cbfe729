"""Photographs that cameras are estimated for: which cannot be taken, and which got no camera."""

import logging
from pathlib import Path

from hydroviews.captures.sfm.sources import link_names
from hydroviews.errors import InputError
from hydroviews.formats.mask_files.matching import mask_folders
from hydroviews.formats.photographs import (
    FOLDERS,
    not_read,
    photographs_below,
    pictures_below,
    require_permission,
    require_target,
    some,
)
from hydroviews.scene.masks import MASKS
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

NOT_IN_COLMAP = (".webp",)  # formats read everywhere else


def check_photographs(images: Path, out: Path) -> None:
    """Refuse what `require_registrable` does, and warn of photographs that will be left out."""
    require_registrable(images, out)
    if images.is_dir() and (left_out := not_read(images)):
        logger.warning("%s: %s", images, left_out)


def masks_of(images: Path) -> Path | None:
    """A folder of masks beside or among photographs, or a mask that lies among them; None where there is none."""
    if not images.is_dir():
        return None
    among = sorted(set(pictures_below(images)) - set(photographs_below(images)))
    folders = [*mask_folders(images), *(mask_folders(images.parent) if images.name in FOLDERS else [])]
    return next(iter([*folders, *among]), None)


def require_registrable(images: Path, out: Path) -> None:
    """Refuse photographs that `estimate_poses` cannot take; warn of masks, which it does not use.

    Args:
        images: folder of the photographs and of folders with more; it need not exist.
        out: folder of the capture. Links to the photographs go to its `images`.

    Raises:
        InputError: formats that COLMAP does not read, a link to nothing, a photograph that may not be read; or `images`
            is that of `out`, and links would have other names than the photographs that lie beside them.
    """
    if not images.is_dir():
        return
    masks = masks_of(images)
    if masks and masks.resolve() != (out / MASKS).resolve():
        logger.warning(
            "%s: masks are not used to estimate cameras and hide nothing; copy them to %s, where they hide what is "
            "behind them when the capture is read", masks, out / MASKS,
        )  # fmt: skip
    sources = photographs_below(images)
    for path in sources:
        require_target(path)
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
                f"{out}: the capture would write links with other names among your photographs",
                found=some(renamed),
                fix="choose another --out",
            )


def without_camera(scene: Scene, images: Path) -> list[str]:
    """Names of the photographs in the folder `images` that are no view's."""
    used = {view.path for view in scene.views}
    return [path.relative_to(images).as_posix() for path in photographs_below(images) if path not in used]


def camera_notes(scene: Scene, images: Path) -> list[str]:
    """A sentence that names the photographs in the folder `images` without a camera; none where each has one."""
    names = without_camera(scene, images)
    return [f"without a camera, and left out: {some(names)}"] if names else []
