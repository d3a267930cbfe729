"""How programs name masks: `000.jpg` has one of these.

| COLMAP | `000.jpg.png` |
| Segment Anything, gsplat | `000.png`, `000.jpg` |
| Metashape | `000_mask.png` |
| RealityScan | `000.jpg.mask.png` |
| instant-ngp | `dynamic_mask_000.png` among the photographs, white where hidden |
"""

import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from hydroviews.scene.images import SUFFIXES

FOLDERS = re.compile(r"((dynamic|object|person|people|transient|sky)_?)?(masks?|segmentations?)(_\d+)?", re.IGNORECASE)
WORD = re.compile(r"(^|[-_. ])(dynamic[-_. ]?)?(masks?|msk|segmentation|matte)(?=$|[-_. ])", re.IGNORECASE)
FOR_ALL = ""  # the key of a mask that is called "mask" alone


def mask_key(name: str) -> str:
    """What the names of a mask and its photograph have in common: no suffixes, capitals and words for a mask."""
    path = PurePosixPath(unicodedata.normalize("NFC", name).lower())
    while path.suffix in (*SUFFIXES, ".mask"):
        path = path.with_suffix("")
    key = WORD.sub("", path.name).strip("-_. ")
    return str(path.with_name(key)) if key else FOR_ALL


def is_called_mask(name: str) -> bool:
    """Whether a file's name says that it is a mask."""
    return WORD.search(PurePosixPath(name).stem) is not None


def without_masks(pictures: Sequence[Path], folder: Path) -> list[Path]:
    """Pictures below a folder but the masks of others among them, by their names or those of their folders."""
    relative = [path.relative_to(folder) for path in pictures]
    in_masks = [any(FOLDERS.fullmatch(part) for part in path.parts[:-1]) for path in relative]
    called = [is_called_mask(path.name) for path in relative]
    if all(in_masks) or (not any(in_masks) and not any(called)):
        return list(pictures)
    photographs = {
        mask_key(path.as_posix())
        for path, inside, mask in zip(relative, in_masks, called, strict=True)
        if not inside and not mask
    }
    return [
        path
        for path, below, inside, mask in zip(pictures, relative, in_masks, called, strict=True)
        if not inside and not (mask and mask_key(below.as_posix()) in photographs)
    ]
