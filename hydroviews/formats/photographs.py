"""Matching a camera file's image names to the files on disk, and making views of both."""

import os
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path, PurePath, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError, no_permission
from hydroviews.files.atomic import is_there, read_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.mask_files.names import without_masks
from hydroviews.scene.cameras import same_shape
from hydroviews.scene.checks import check_view_name
from hydroviews.scene.file_kinds import file_kind
from hydroviews.scene.images import SUFFIXES, image_size, list_images
from hydroviews.scene.lenses import Lens
from hydroviews.scene.masks import MASKS, find_mask
from hydroviews.scene.scenes import Split, View, wrong_size

RAW = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".gpr", ".pef", ".srw", ".3fr", ".iiq", ".raw")
LIGHT = (".exr", ".hdr", ".tga", ".psd", ".dds")
UNREAD = (".heic", ".heif", ".avif", ".jxl", ".jfif", ".jpe", ".jp2", ".ppm", ".gif", ".insp", *LIGHT, *RAW)
READABLE = {"JPEG": ".jpg", "PNG": ".png", "WebP": ".webp", "BMP": ".bmp"}  # suffix by `file_kind`
NOT_OURS = (".", "@eaDir", "#recycle", "@Recycle", "__MACOSX")  # begin names of folders that no photographs are in
SPLIT = "split.json"
NUMBERED = ("clutter", "extra")  # parts of a split that numbers photographs (see `paired_pictures`)
Match = Callable[[Path, Sequence[str]], list[Path | None]]  # of a folder and a camera file's names, as `match_files`
FOLDERS = ("images", "clean", "input", "images_2", "images_4", "images_8")


def image_folder(folder: Path, given: str | None = None) -> Path:
    """The folder with a capture's photographs: `given`, or the first of FOLDERS that holds any.

    Raises:
        InputError: there is none.
    """
    for name in (given,) if given else FOLDERS:
        if (folder / name).is_dir() and photographs_below(folder / name):
            return folder / name
    raise InputError(
        f"{folder}: no photographs beside the cameras",
        found=not_read(folder) or ", ".join(sorted(p.name for p in folder.glob("[!.]*"))) or "an empty folder",
        expected=f"a folder {given or ', '.join(FOLDERS)} with {', '.join(SUFFIXES)} files",
    )


def photographs_below(folder: Path) -> list[Path]:
    """All photographs in `folder` and the folders in it, sorted; hidden and partial files and masks are left out.

    Raises:
        InputError: the user has no permission to read the folder.
    """
    return without_masks(pictures_below(folder), folder)


def pictures_below(folder: Path) -> list[Path]:
    """`photographs_below` with the masks among them.

    Raises:
        InputError: the user has no permission to read the folder.
    """
    require_permission(folder)
    return _files_below(folder, SUFFIXES)


def _files_below(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """Files and links by suffix, without what stands below hidden folders and those of network storage."""
    found = []
    for here, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(NOT_OURS)]
        found += [Path(here, name) for name in files if Path(name).suffix.lower() in suffixes]
    return sorted(path for path in found if not path.name.startswith("."))


def require_permission(path: Path) -> None:
    """Refuse a file or folder that may not be read, before what is in it is blamed.

    Raises:
        InputError: the user has no permission.
    """
    if os.path.exists(path) and not os.access(path, os.R_OK):
        raise no_permission(path)


def require_target(path: Path) -> None:
    """Refuse a link to a photograph that is not there.

    Raises:
        InputError: it is one.
    """
    if path.is_symlink() and not path.exists():
        raise InputError(
            f"{path}: a link to a photograph that is not there",
            found=os.readlink(path),
            fix="put the photograph back or remove the link; where the `poses` or `reconstruct` command made it, give "
            "that again with the folder that the photographs are in now",
        )


def unreadable_photographs(folder: Path) -> str:
    """How many files are photographs in formats that are not read here, such as "50 .heic"; empty if none are."""
    suffixes = Counter(path.suffix.lower() for path in _files_below(folder, UNREAD))
    return ", ".join(f"{count} {suffix}" for suffix, count in sorted(suffixes.items()))


def not_read(folder: Path) -> str:
    """`unreadable_photographs` as a sentence; empty if there are none."""
    count = unreadable_photographs(folder)
    if not count:
        return ""
    kinds = {file_kind(path) for path in _files_below(folder, UNREAD)}
    if kinds <= READABLE.keys():  # such as JPEG that a telephone names .HEIC
        named = ", ".join(f"{kind} by content: rename them to {READABLE[kind]}" for kind in sorted(kinds))
        return f"{count}, {named}"
    return f"{count}, which are not read: convert them to .png or .jpg"


def one_by_one(pictures: Path, out: Path) -> dict[Path, Path]:
    """The PNG in folder `out` for a picture, or for each one directly in a folder of them.

    Raises:
        InputError: no pictures, two of one name, or one that would be written over.
    """
    files = list_images(pictures) if pictures.is_dir() else [pictures]
    if not files:
        found = unreadable_photographs(pictures) or "none of them"
        raise InputError(f"{pictures}: no pictures", found=found, expected=f"{', '.join(SUFFIXES)} files")
    targets = {file: out / f"{file.stem}.png" for file in files}
    twice = [name for name, count in Counter(target.name for target in targets.values()).items() if count > 1]
    if twice:
        raise InputError(f"{pictures}: several pictures would become {some(twice)}", fix="rename them")
    if {file.resolve() for file in files} & {target.resolve() for target in targets.values()}:
        raise InputError(f"{out}: pictures would be written over", fix="choose another --out")
    return targets


def match_files(folder: Path, names: Sequence[str]) -> list[Path | None]:
    """The file in `folder` for each name in a camera file, None where there is none.

    A file of the same name with another suffix counts: smaller copies are often stored in another format. So does one
    whose umlauts are stored as letter and mark, as macOS does. Where that finds nothing, other capitals, and folders
    more or less before the name, count as well where only one name and one file fit so.
    """
    files = photographs_below(folder)
    by_stem = {composed_stem(path.relative_to(folder).as_posix()): path for path in files}
    found = [folder / name if (folder / name).is_file() else by_stem.get(composed_stem(name)) for name in names]
    if all(found):
        return found
    relative = [path.relative_to(folder).as_posix() for path in files]
    for loosely in (_lower, _last_lower):
        left = [name for name, file in zip(names, found, strict=True) if file is None]
        taken = set(found)
        free = dict(zip(relative, files, strict=True))
        once = _once({name: loosely(name) for name, path in free.items() if path not in taken})
        matches = {
            key: once[loose] for loose, key in _once({name: loosely(name) for name in left}).items() if loose in once
        }
        found = [
            free[matches[name]] if file is None and name in matches else file
            for name, file in zip(names, found, strict=True)
        ]
    return found


def _lower(name: str) -> str:
    return composed_stem(name).lower()


def _last_lower(name: str) -> str:
    return PurePosixPath(composed_stem(name)).name.lower()


def _once(names: Mapping[str, str]) -> dict[str, str]:
    """From a loose name to the name that alone has it."""
    counts = Counter(names.values())
    return {loose: name for name, loose in names.items() if counts[loose] == 1}


def posix_name(name: object) -> object:
    """A file name in a camera file with forward slashes, which programs on Windows do not write; else what it is."""
    return name.replace("\\", "/") if isinstance(name, str) else name


def stem(name: str) -> str:
    """A photograph's name without its suffix, with the folders before it."""
    path = PurePosixPath(name)
    return str(path.with_suffix("")) if path.suffix.lower() in SUFFIXES else str(path)


def composed_stem(name: str) -> str:
    """`stem` for comparing names: a letter and its mark are one character (Unicode's NFC)."""
    return unicodedata.normalize("NFC", stem(name))


def all_files(camera_file: Path, folder: Path, names: Sequence[str], match: Match = match_files) -> list[Path]:
    """`match` where every photograph must be there.

    Raises:
        InputError: some are missing, or the camera file is of another capture altogether.
    """
    files = match(folder, names)
    missing = [name for name, file in zip(names, files, strict=True) if file is None]
    if missing and len(missing) == len(names):
        raise other_images(camera_file, folder, names)
    if missing:
        raise InputError(
            f"{camera_file}: {len(missing)} of its {len(names)} images are not in {folder}",
            found="no " + some(missing),
            fix="copy the missing images there, or estimate the poses again from the ones that are left",
        )
    return [file for file in files if file is not None]


def other_images(camera_file: Path, folder: Path, names: Sequence[str]) -> InputError:
    """The error for a camera file none of whose images is there."""
    holds = some([path.name for path in photographs_below(folder)] or [not_read(folder) or "nothing"])
    return InputError(
        f"{camera_file}: a camera file for other images",
        found=f"cameras for {some(names)}; {folder} holds {holds}",
        expected="the same names",
        fix="put the camera file beside the images it was made from",
    )


def some(names: Sequence[str]) -> str:
    """The first few names, and how many more there are."""
    shown = ", ".join(names[:5])
    return f"{shown} and {len(names) - 5} more" if len(names) > 5 else shown or "nothing"


def view_names(names: Sequence[str]) -> list[str]:
    """File names without folder and suffix; with the folders, joined by underscores, where two would be the same."""
    stems = [PurePosixPath(stem(name)) for name in names]
    counts = Counter(stem.name for stem in stems)
    if max(counts.values(), default=1) == 1:
        return [stem.name for stem in stems]
    return ["_".join(part for part in stem.parts if part not in (".", "..", "/")) for stem in stems]


def make_view(
    name: str, path: Path, lens: Lens, world_to_camera: NDArray[np.float64], mask: Path | None = None
) -> View:
    """A view of the photograph at its own size, which may be a multiple or fraction of the lens's.

    Raises:
        InputError: the photograph has another shape than the lens, or cannot be read, or its name or its lens are
            against the rules of `scene.checks`.
    """
    check_view_name(path, name)
    require_target(path)
    require_permission(path)
    size = image_size(path)
    if not same_shape(size, (lens.width, lens.height)):
        raise wrong_size(path, size, (lens.width, lens.height))
    try:
        camera = lens.pinhole(size).camera(world_to_camera)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return View(name, camera, path, None if lens.is_pinhole else lens, mask)


def mask_beside(folder: Path, photographs: Path, file: Path) -> Path | None:
    """The mask of a photograph in a capture's `masks`, None where there is none.

    One that does not lie among the other photographs has its mask by its name alone.
    """
    name = file.relative_to(photographs).as_posix() if file.is_relative_to(photographs) else file.name
    return find_mask(folder / MASKS, name)


def below_first(name: PurePath) -> PurePosixPath:
    """A photograph's name in a capture as seen from the folder that the photographs are in."""
    return PurePosixPath(*(name.parts[1:] or name.parts))


def read_split(folder: Path) -> Split | None:
    """The split in `split.json`, of the folder itself or of the built scene it is a rainy variant of, in order of name.

    None where there is no file, or one that numbers photographs.

    Raises:
        InputError: the file is not {"train": [names], "test": [names]}, with or without "sparse": [names].
    """
    path = folder / SPLIT
    if not is_there(path) and (folder.name == CAPTURED or (folder.parent / "clean").is_dir()):
        path = folder.parent / SPLIT
    if not is_there(path):
        return None
    content = read_json(path)
    if isinstance(content, dict) and set(NUMBERED) <= set(content):
        return None
    content = {"sparse": [], **content} if isinstance(content, dict) else {}
    parts = ("train", "test", "sparse")
    if not all(_is_names(content.get(part)) for part in parts):
        raise InputError(f"{path}: not a split", expected='{"train": [view names], "test": [view names]}')
    train, test, sparse = (tuple(sorted(content[part])) for part in parts)
    return Split(train, test, sparse)


def _is_names(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)
