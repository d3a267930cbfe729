"""A small built data set to hand on, and archives of it that somebody spoilt."""

import json
import stat
import zipfile
from pathlib import Path

from synthetic import written_capture

from hydroviews.dataset.build import build
from hydroviews.dataset.manifest import read_manifest
from hydroviews.formats.read import read_scene
from hydroviews.profiles import find_profile
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import parse_pattern

LONG_SIDE = find_profile("demo").long_side
SHAREABLE = {"licence": "CC-BY-4.0", "shareable": True}


def built_in(folder: Path, patterns=("streak-1", "storm-1"), says=SHAREABLE, name="yard", **size) -> Path:
    """A scene built in `folder/data` from a capture that states its licence."""
    capture = written_capture(folder / "captures" / name, **size)
    if says:
        (capture / "capture.json").write_text(json.dumps(says))
    scene = read_scene(capture)
    rains: list[Pattern] = [parse_pattern(one) for one in patterns]
    return build(scene, folder / "data", patterns=rains, long_side=LONG_SIDE, source=str(capture))


def rewritten(archive: Path, target: Path, change) -> Path:
    """The archive with its list of (ZipInfo, content) changed."""
    with zipfile.ZipFile(archive) as opened:
        members = [(info, opened.read(info)) for info in opened.infolist()]
    with zipfile.ZipFile(target, "w") as written:
        for info, content in change(members):
            written.writestr(info, content, info.compress_type)
    return target


def member(name: str, mode: int = stat.S_IFREG | 0o644) -> zipfile.ZipInfo:
    """A member of any name."""
    info = zipfile.ZipInfo("x")
    info.filename, info.external_attr = name, mode << 16
    return info


def facts_of(built: Path) -> dict:
    """The manifest's entry of the scene, without the hashes of its files."""
    entry = read_manifest(built.parent)["scenes"][built.name]
    return {key: value for key, value in entry.items() if key != "files"}
