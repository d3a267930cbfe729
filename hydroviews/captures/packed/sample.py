"""The sample clip: a rainy video of an embedded scene, to try a reconstruction without a video of one's own.

`examples/rainy_clip.py` draws the clip.
"""

from pathlib import Path

from hydroviews.captures.packed.archives import FOLDER, read_checked
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes

SAMPLE = "sample"
CLIP = f"{SAMPLE}.mp4"


def copy_sample(folder: Path, shipped: Path = FOLDER) -> Path:
    """Copy the clip into a folder, unless the same clip is there.

    Args:
        folder: takes `sample.mp4`; created if missing.
        shipped: folder of the clip and its hash.

    Returns:
        The copy.

    Raises:
        InputError: the shipped clip is damaged, or another file has the name of the copy.
    """
    content, target = read_checked(shipped / CLIP), folder / CLIP
    if not target.exists():
        write_bytes(target, content)
    elif not target.is_file() or target.read_bytes() != content:
        raise InputError(
            f"{target}: another file",
            expected="no file of this name, or the sample clip",
            fix="choose another folder with --out",
        )
    return target
