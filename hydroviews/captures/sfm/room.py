"""Room on the disk for pycolmap's database of features and matches."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hydroviews.files.full_disk import FullDisk, plain_full_disk

DATABASE = "database.db"
PAIRS = "pairs.txt"  # beside it: those that are being matched
LEARNED = "database.db.learned"  # beside it: a folder of learned features and their matches
NEEDED = 1_000_000  # bytes for a photograph: up to 4096 features, and their matches


@contextmanager
def room_for(out: Path, photographs: int) -> Iterator[None]:
    """Refuse a disk without room for the cameras or points of photographs, and say so where it fills up in the block.

    pycolmap ends the process where threads of its own find the disk full, so it is looked at first.

    Args:
        out: where the database goes; it need not exist.
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
