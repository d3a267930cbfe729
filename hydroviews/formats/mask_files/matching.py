"""Masks as other programs name them: found for the photographs, and told where they fit none.

People hide faces and number plates with masks, so that a mask that is passed over is told. One called
`mask.png` alone is for all photographs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import PIL.Image

from hydroviews.formats.mask_files.names import FOLDERS, FOR_ALL, is_called_mask, mask_key
from hydroviews.formats.photographs import below_first, pictures_below, some
from hydroviews.scene.images import image_size
from hydroviews.scene.masks import MASKS, mask_name, read_transparent
from hydroviews.scene.scenes import Scene, View

BUDGET = 8e6  # pixels of photographs with an alpha channel that are looked at
OPAQUE = (".jpg", ".jpeg", ".bmp")  # formats without


def mask_folders(folder: Path) -> list[Path]:
    """Folders of a capture that are called after masks, `masks` first."""
    found = [one for one in folder.iterdir() if one.is_dir() and FOLDERS.fullmatch(one.name)]
    return sorted(found, key=lambda one: (one.name != MASKS, one.name))


def with_masks(scene: Scene, folder: Path) -> tuple[Scene, list[str]]:
    """The scene with the masks that its reader did not find by their exact names, and sentences to warn with.

    Args:
        scene: as it was read.
        folder: the capture.
    """
    used = {view.mask for view in scene.views if view.mask}
    candidates = {}
    for masks in mask_folders(folder):
        inside = [path for path in pictures_below(masks) if path not in used]
        candidates = {path: path.relative_to(masks).as_posix() for path in inside}
        if candidates or any(mask.is_relative_to(masks) for mask in used):
            break  # other folders have the same masks at other sizes
    for photographs in {view.path.parent for view in scene.views}:
        beside = [path for path in pictures_below(photographs) if is_called_mask(path.name)]
        own = {view.path for view in scene.views}
        candidates |= {path: _below(path, folder) for path in beside if path not in own | used}
    matched, left = _matched(scene.views, folder, candidates)
    views = tuple(replace(view, mask=view.mask or matched.get(view)) for view in scene.views)
    views = with_alpha(views)
    return replace(scene, views=views), _left_over(scene, folder, sorted(left), bool(used or matched))


def with_alpha(views: Sequence[View]) -> tuple[View, ...]:
    """The views; those without a mask whose photographs have transparent pixels hide these.

    Photographs of many pixels are not all looked at: an alpha channel is then a mask, be it opaque.
    """
    clear = [view for view in views if view.mask is None and has_alpha(view.path)]
    if not clear:
        return tuple(views)
    width, height = image_size(clear[0].path)
    looked_at = clear[: max(1, int(BUDGET // (width * height)))]
    if len(looked_at) == len(clear) and not any(read_transparent(view.path).any() for view in looked_at):
        return tuple(views)
    hidden = {view.name for view in clear}
    return tuple(replace(view, mask=view.path) if view.name in hidden else view for view in views)


def has_alpha(path: Path) -> bool:
    """Whether a picture's header says that its pixels have an opacity."""
    if path.suffix.lower() in OPAQUE:
        return False
    try:
        with PIL.Image.open(path) as picture:
            return picture.mode in ("RGBA", "LA", "PA", "RGBa", "La") or "transparency" in picture.info
    except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError):
        return False  # reading the pixels will raise what is wrong


def _below(path: Path, folder: Path) -> str:
    return str(below_first(path.relative_to(folder))) if path.is_relative_to(folder) else path.name


def _matched(
    views: Sequence[View], folder: Path, candidates: Mapping[Path, str]
) -> tuple[dict["View", Path], list[Path]]:
    """The mask of each view that has none by now, and the candidates that fit none."""
    bare = [view for view in views if view.mask is None]
    by_key = _alone((mask_key(_below(view.path, folder)), view) for view in views)
    by_name = _alone((mask_key(view.path.name), view) for view in views)
    matched: dict[View, Path] = {}
    left = []
    for path, name in candidates.items():
        view = by_key.get(mask_key(name)) or by_name.get(mask_key(PurePosixPath(name).name))
        if view is not None and view.mask is None and view not in matched:
            matched[view] = path
        elif mask_key(name) == FOR_ALL and len(candidates) == 1:
            matched |= dict.fromkeys(bare, path)
        else:
            left.append(path)
    return matched, left


def _alone(named: Iterable[tuple[str, View]]) -> dict[str, View]:
    """Views by key, but those that share one."""
    pairs = list(named)
    keys = [key for key, _ in pairs]
    return {key: view for key, view in pairs if keys.count(key) == 1}


def _left_over(scene: Scene, folder: Path, left: Sequence[Path], some_are_used: bool) -> list[str]:
    """A sentence on masks that are for no photograph."""
    if not left:
        return []
    wanted = mask_name(_below(scene.views[0].path, folder))
    names = some([path.name for path in left])
    if some_are_used:
        return [f"{len(left)} masks fit no photograph and hide nothing ({names}); expected names such as {wanted}"]
    where = left[0].parent.name
    return [f"no masks: of {len(left)} pictures in {where} none is named as it should be, such as {wanted}"]
