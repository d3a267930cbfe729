"""Files of folders, compared and damaged."""

import json
import re
from pathlib import Path

from hydroviews.dataset.manifest import scene_files
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.images import read_image, write_png


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in scene_files(folder)}


def files(folder: Path) -> dict[str, bytes]:
    """All files below a folder by their paths, without what is hidden there."""
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in sorted(found.items()) if not re.search(r"(^|/)\.", name)}


def edit(path: Path, **changes: object) -> None:
    """Change values of a JSON file."""
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def damage(path: Path) -> None:
    """Change a file's last bytes, as a bad disk would."""
    content = path.read_bytes()
    write_bytes(path, content[:-4] + bytes(255 - byte for byte in content[-4:]))


def paint(path: Path) -> None:
    """Make another picture of a picture."""
    write_png(path, 1 - read_image(path))
