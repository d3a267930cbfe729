"""The photographs of paired captures: taken in rain and clean ones, with the cameras of all of them in one file.

Three forms are known; `find_pictures` tells them apart:

rainy/, clean/              two folders. Photographs of one name are of one camera, which did not move between them;
                            where both have a camera, the clean one's is taken. A name in one folder alone is a view
                            of its own.
clutter*, clean*, extra*    names in one folder of photographs, with or without a number before: clutter is trained on,
                            extra held out (as the SpotLessSplats code reads RobustNeRF's scenes); without any extra,
                            clean is held out. A clean* without a camera is the clean photograph of the clutter* of
                            the same ending.
split.json                  {"clutter": [numbers], "extra": [numbers]} of the photographs in order of their names, those
                            of `transforms.json` where there is one (NeRF On-the-go, as nerfbaselines reads it)

"Rainy" stands for whatever the clean photographs are free of.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from hydroviews.errors import InputError
from hydroviews.files.atomic import is_there, read_json
from hydroviews.formats.nerfstudio import CAMERA_FILE
from hydroviews.formats.photographs import FOLDERS, NUMBERED, SPLIT, composed_stem, not_read, photographs_below, some

RAINY, CLEAN = "rainy", "clean"
CLUTTER, EXTRA = "clutter", "extra"
PREFIX = re.compile(rf"\d*({CLUTTER}|{CLEAN}|{EXTRA})(.*)")
Files = Mapping[str, Path]


@dataclass(frozen=True)
class Pictures:
    """The photographs of a paired capture, by keys that the rainy and the clean one of a camera share.

    Attributes:
        folders: the rainy ones', and the clean ones' where that is another.
        rainy, clean: photographs by key.
        extra: clean photographs that are held out by their name, none of them in `clean`.
        named: all of them by the names that a camera file may have for them, in lower case and without suffix.
        together: photographs of one key are of one camera, even where both have one.
    """

    folders: tuple[Path, ...]
    rainy: Files
    clean: Files
    named: Files
    extra: Files = field(default_factory=dict)
    together: bool = False

    def match(self, _: Path, names: Sequence[str]) -> list[Path | None]:
        """The photograph for each name in a camera file: the rainy one where both have the name; None for none."""
        return [next((self.named[key] for key in _keys(name) if key in self.named), None) for name in names]


def _key(name: str) -> str:
    return composed_stem(name).lower()


def _keys(name: str) -> Iterator[str]:
    """A name's key, then without the folders that it begins with, one by one."""
    parts = PurePosixPath(_key(name)).parts
    return ("/".join(parts[i:]) for i in range(len(parts)))


def find_pictures(folder: Path, images: str | None = None) -> Pictures | None:
    """The photographs of a paired capture; None where the capture is another one.

    Args:
        folder: of the capture.
        images: folder of the photographs inside it, where it is not one of the usual ones.

    Raises:
        InputError: one of the folders is empty, two photographs have one name, or an odd `split.json`.
    """
    below = {path.name.lower(): path for path in sorted(folder.iterdir()) if path.is_dir()}
    if RAINY in below and CLEAN in below:
        return _in_two_folders(below[RAINY], below[CLEAN])
    one = next((folder / name for name in ([images] if images else FOLDERS) if (folder / name).is_dir()), None)
    if one is None:
        return None
    photographs = _by_key(one)
    numbers = _numbered_split(folder)
    if numbers:
        return _by_number(folder / SPLIT, one, photographs, numbers)
    parts = {key: PREFIX.fullmatch(PurePosixPath(key).name) for key in photographs}
    return _by_prefix(one, photographs, parts)


def _in_two_folders(rainy_folder: Path, clean_folder: Path) -> Pictures:
    rainy, clean = _by_key(rainy_folder), _by_key(clean_folder)
    for folder, files, other in ((rainy_folder, rainy, clean), (clean_folder, clean, rainy)):
        if not files:
            raise InputError(
                f"{folder}: no photographs",
                found=not_read(folder) or f"nothing, and {len(other)} in the folder beside it",
                expected=f"photographs in both {RAINY} and {CLEAN}",
                fix="copy them there; without clean ones, call the rainy folder images and say so in capture.json",
            )
    named = {**clean, **rainy}
    named |= {f"{RAINY}/{key}": path for key, path in rainy.items()}
    named |= {f"{CLEAN}/{key}": path for key, path in clean.items()}
    return Pictures((rainy_folder, clean_folder), rainy, clean, named, together=True)


def _by_prefix(folder: Path, photographs: Files, parts: Mapping[str, re.Match[str] | None]) -> Pictures | None:
    """The photographs by what their names begin with; None unless all do, some with clutter, not all.

    Raises:
        InputError: two photographs whose names differ in the number in front of them only.
    """
    found: dict[str, dict[str, Path]] = {CLUTTER: {}, CLEAN: {}, EXTRA: {}}
    for key, part in parts.items():
        if part is None:
            return None
        shared = f"{PurePosixPath(key).parent}/{part[2]}"
        if twin := found[part[1]].get(shared):
            raise InputError(
                f"{folder}: two {part[1]} photographs of one name but for the number in front of it",
                found=f"{twin.name}, {photographs[key].name}",
                fix="move one of the two sets to another folder, or rename it",
            )
        found[part[1]][shared] = photographs[key]
    if not found[CLUTTER] or not (found[CLEAN] or found[EXTRA]):
        return None
    return Pictures((folder,), found[CLUTTER], found[CLEAN], photographs, found[EXTRA])


def _by_number(path: Path, folder: Path, photographs: Files, numbers: Mapping[str, Sequence[int]]) -> Pictures:
    cameras = path.with_name(CAMERA_FILE)
    if is_there(cameras):
        frames = read_json(cameras).get("frames", [])
        names = sorted(_key(PurePosixPath(str(frame.get("file_path", ""))).name) for frame in frames)
    else:
        names = sorted(photographs)
    parts = []
    for kind in NUMBERED:
        odd = [number for number in numbers[kind] if not 0 <= number < len(names)]
        if odd:
            raise InputError(
                f"{path}: numbers of photographs that are not there",
                found=f"{kind}: {some(list(map(str, odd)))}",
                expected=f"0 to {len(names) - 1}, in the order of the photographs' names",
            )
        chosen = (names[number] for number in numbers[kind])
        parts.append({key: photographs[key] for key in chosen if key in photographs})
    return Pictures((folder,), parts[0], {}, photographs, parts[1])


def _numbered_split(folder: Path) -> dict[str, list[int]] | None:
    """The content of a `split.json` that numbers photographs; None where there is none."""
    path = folder / SPLIT
    content = read_json(path) if is_there(path) else None
    if not isinstance(content, dict) or not set(NUMBERED) <= set(content):
        return None
    lists = [content[kind] for kind in NUMBERED]
    if not all(isinstance(one, list) and all(type(number) is int for number in one) for one in lists):
        raise InputError(f"{path}: not a split", expected='{"clutter": [numbers], "extra": [numbers]}')
    return dict(zip(NUMBERED, lists, strict=True))


def _by_key(folder: Path) -> dict[str, Path]:
    """The photographs in a folder; names of another case or suffix are one key.

    Raises:
        InputError: two photographs have one.
    """
    files = photographs_below(folder)
    keys = [_key(file.relative_to(folder).as_posix()) for file in files]
    twice = [key for key, count in Counter(keys).items() if count > 1]
    if twice:
        same = [file.name for file, key in zip(files, keys, strict=True) if key == twice[0]]
        raise InputError(
            f"{folder}: several photographs of one name",
            found=f"{' and '.join(same)}; {len(twice)} names in all",
            expected="each name once, whatever its suffix and case",
            fix="remove the copies that are not wanted",
        )
    return dict(zip(keys, files, strict=True))
