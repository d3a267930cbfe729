"""Speed of packing and fetching, against copying the same files and hashing them.

    python -m benchmarks.sharing data/demo/mipnerf360_bonsai streak-1

Packs one variant of a built scene, takes it into an empty folder, and copies and hashes its files one by one. Prints
processor seconds for 10^9 bytes, each the least of several turns, and how far memory rose beyond that of the start.
"""

import hashlib
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import tyro

from hydroviews.cli.commands import run_command
from hydroviews.dataset.sharing.archive import Packed, open_archive
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack

TURNS = 3


def measured(action: Callable[[Path], object], folder: Path, gigabytes: float) -> tuple[float, float]:
    """Processor seconds for 10^9 bytes, the least of TURNS, and by how many 10^6 bytes the peak of memory rose."""
    before, seconds = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, []
    for turn in range(TURNS):
        start = time.process_time()
        action(folder / str(turn))
        seconds.append(time.process_time() - start)
        shutil.rmtree(folder / str(turn))
    rise = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return min(seconds) / gigabytes, rise * 1024 / 1e6


def copied(built: Path, names: list[str], target: Path) -> None:
    """Copy files and hash the copies, as one would by hand."""
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(built / name, target / name)
        with (target / name).open("rb") as file:
            hashlib.file_digest(file, "sha256")


def unpacked(packed: Packed, target: Path) -> None:
    """Write and compare the files of an archive, without what describes the scene."""
    for name in packed.places:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        packed.copy(name, target / name)


def main(built: Annotated[Path, tyro.conf.Positional], variant: Annotated[str, tyro.conf.Positional]) -> None:
    """Measure one variant.

    Args:
        built: the folder of a built scene.
        variant: its name, such as streak-1.
    """
    with tempfile.TemporaryDirectory(prefix="hydroviews-", dir=".") as folder:
        here = Path(folder)
        rights = "measured here, not handed on"
        [(path, _)] = pack(built, here / "first", patterns=[variant], owner_says=rights)
        packed, size = open_archive(path), path.stat().st_size / 1e9
        names = [name for name in packed.places if (built / name).is_file()]
        ways: dict[str, Callable[[Path], object]] = {
            "copy + sha256": lambda target: copied(built, names, target),
            "pack": lambda target: list(pack(built, target, patterns=[variant], owner_says=rights)),
            "fetch FILE: unpack": lambda target: unpacked(packed, target),
            "fetch FILE: all": lambda target: fetch(str(path), target),
        }
        print(f"{variant} of {built.name}: {len(names)} files, {size:.3f} GB")
        for name, way in ways.items():
            seconds, rise = measured(way, here, size)
            print(f"{name:20} {seconds:6.2f} s/GB  peak memory +{rise:.0f} MB")


if __name__ == "__main__":
    run_command(main, prog="benchmarks.sharing")
