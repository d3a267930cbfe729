"""The archive of a variant: a zip whose files are stored as they are, and the manifest they are compared with.

    manifest.json            that of a data folder with this variant alone, and `left_out`: names that are not packed
    croissant.json           metadata
    <scene>/...              the scene's files

Pictures and layers are compressed already, so nothing is compressed again, and any file can be read where it lies.
The same files give the same bytes: members stand in order of name, with one date and one mode.
"""

import hashlib
import importlib.machinery
import stat
import struct
import tempfile
import unicodedata
import zipfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from tqdm import tqdm

from hydroviews.captures.download.archives import ANOTHER, BadArchive, opened_archive, refused, safe_parts
from hydroviews.dataset.manifest import MANIFEST, read_manifest
from hydroviews.dataset.sharing.croissant import CROISSANT
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.files.known_bytes import changed

LEFT_OUT = "left_out"  # key of the archive's manifest
BLOCK = 1 << 20  # bytes
DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can say
UNIX, PLAIN_FILE = 3, (stat.S_IFREG | 0o644) << 16
LOCAL_HEADER, LENGTHS = 30, struct.Struct("<26x2H")  # bytes of a member's header before its name; name and extra field
CODE = tuple(importlib.machinery.all_suffixes())  # of files that Python would import
REPACK = "pack it again, or fetch it again from where it was published"


@dataclass(frozen=True)
class Packed:
    """An archive that was opened and looked through; it can be pickled, and holds no file open."""

    path: Path
    scene: str
    entry: Mapping[str, Any]  # of the scene, in the manifest
    left_out: frozenset[str]  # names of listed files that are not in the archive
    places: Mapping[str, tuple[int, int]]  # first byte and number of bytes, by name in the scene

    def blocks(self, name: str) -> Iterator[bytes]:
        """The bytes of a file, in pieces.

        Raises:
            BadArchive: they are not what the manifest says, or there are too few; known when all pieces are read.
        """
        digest, (start, left) = hashlib.sha256(), self.places[name]
        with self.path.open("rb") as file:
            file.seek(start)
            while left and (block := file.read(min(BLOCK, left))):
                left -= len(block)
                digest.update(block)
                yield block
        if digest.hexdigest() != self.entry["files"][name]:
            raise BadArchive(
                f"{self.path}: {name} is not what the manifest says",
                found=f"SHA-256 {digest.hexdigest()[:16]}",
                expected=f"SHA-256 {self.entry['files'][name][:16]}",
                fix=REPACK,
            )

    def copy(self, name: str, target: Path) -> None:
        """Write a file of the archive to `target`.

        Raises:
            BadArchive: see `blocks`; what was written so far stays.
        """
        with target.open("wb") as file:
            for block in self.blocks(name):
                file.write(block)

    @contextmanager
    def file(self, name: str) -> Iterator[Path]:
        """A file of the archive as one on disk, until the block ends.

        Raises:
            InputError: the archive does not have it, or it is not what the manifest says.
        """
        if name not in self.places:
            raise InputError(f"{self.path}: no {name} in it")
        with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder:
            path = Path(folder, PurePosixPath(name).name)
            self.copy(name, path)
            yield path


def write_archive(path: Path, title: str, members: Mapping[str, Path | bytes], hashes: Mapping[str, str]) -> str:
    """Write members in the order given; files are read once, and memory is that of a block.

    Args:
        path: of the archive, which may be a temporary one.
        title: the name that progress shows.
        members: files or their content by name in the archive.
        hashes: SHA-256 by name, that the files must have.

    Returns:
        The archive's SHA-256.

    Raises:
        InputError: a file is missing or changed.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, content in tqdm(members.items(), desc=f"packing {title}", unit="file", leave=False):
            info = zipfile.ZipInfo(name, DATE)
            info.create_system, info.external_attr = UNIX, PLAIN_FILE
            info.file_size = len(content) if isinstance(content, bytes) else _size(content)
            digest = hashlib.sha256()
            with archive.open(info, "w") as target:
                for block in [content] if isinstance(content, bytes) else _file_blocks(content):
                    digest.update(block)
                    target.write(block)
            if isinstance(content, Path) and digest.hexdigest() != hashes[name]:
                raise changed(content, digest.hexdigest(), hashes[name])
    return sha256(path)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        raise InputError(f"{path}: missing", fix="build the scene again with --repair") from None


def _file_blocks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            yield block


def open_archive(path: Path) -> Packed:
    """Look through an archive that `pack` wrote; files are compared with the manifest as they are read.

    Whatever it could harm with is refused: names that lead out of the scene, come twice or differ only by case, links,
    compressed members (which may be small here and huge unpacked), code, files that the manifest does not list.

    Raises:
        BadArchive: it is damaged, or not such an archive.
        InputError: there is no such file.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such archive", fix="give the address or the file that `hydroviews pack` wrote")
    with opened_archive(path) as opened:
        if not isinstance(opened, zipfile.ZipFile):
            raise _foreign(path, "a tar archive")
        infos = opened.infolist()
        _refuse_odd_members(path, infos)
        if MANIFEST not in opened.namelist():
            raise _foreign(path, f"{len(infos)} files and no {MANIFEST}")
        manifest = _manifest(path, opened.read(MANIFEST))  # compared with the checksum that zip has of it
        places = {info.filename: (_first_byte(path, info), info.file_size) for info in infos}
    if len(manifest["scenes"]) != 1 or not isinstance(manifest.get(LEFT_OUT, []), list):
        raise _foreign(path, f"{len(manifest['scenes'])} scenes")
    scene, entry = next(iter(manifest["scenes"].items()))
    left_out = frozenset(map(str, manifest.get(LEFT_OUT, [])))
    expected = {f"{scene}/{name}": name for name in entry["files"] if name not in left_out}
    _refuse_other_members(path, set(places) - {MANIFEST, CROISSANT}, expected)
    return Packed(path, scene, entry, left_out, {name: places[full] for full, name in expected.items()})


def _refuse_odd_members(path: Path, infos: Sequence[zipfile.ZipInfo]) -> None:
    """Refuse what `write_archive` never writes."""
    refuse_odd_names(path, [info.filename for info in infos])
    for info in infos:
        mode = info.external_attr >> 16
        if info.orig_filename != info.filename:
            raise refused(path, info.orig_filename, "a name that was cut")
        if info.is_dir() or not stat.S_ISREG(mode):
            raise refused(path, info.filename, "a link" if stat.S_ISLNK(mode) else "no plain file")
        if info.filename.casefold().endswith(CODE):
            raise refused(path, info.filename, "a file that Python could import")
        if info.flag_bits & 1 or info.compress_type != zipfile.ZIP_STORED or info.compress_size != info.file_size:
            raise refused(path, info.filename, "an encrypted or compressed file")
    total, size = sum(info.file_size for info in infos), path.stat().st_size
    if total > size:
        raise refused(path, f"{total} bytes", f"more than the {size} bytes of the archive")


def refuse_odd_names(path: Path, names: Collection[str], fix: str = ANOTHER) -> None:
    """Refuse names that lead outside, that some file system takes for one, or of which one is the folder of another.

    Raises:
        BadArchive: there are such names; `fix` says what to do.
    """
    for name in names:
        safe_parts(path, name, fix)
    folded = Counter(unicodedata.normalize("NFC", name).casefold() for name in names)
    above = {parent.as_posix() for name in folded for parent in PurePosixPath(name).parents}
    twice = sorted(name for name, count in folded.items() if count > 1 or name in above)
    if twice:
        raise refused(path, twice[0], "a name that comes twice, or differs only by case", fix)


def _refuse_other_members(path: Path, found: set[str], expected: Collection[str]) -> None:
    strange, absent = sorted(found - set(expected)), sorted(set(expected) - found)
    if strange:
        raise refused(path, strange[0], f"{len(strange)} files that its manifest does not list")
    if absent:
        raise BadArchive(f"{path}: incomplete", found=f"no {absent[0]}, of {len(absent)} files", fix=REPACK)


def _manifest(path: Path, content: bytes) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder:
        Path(folder, MANIFEST).write_bytes(content)
        try:
            return read_manifest(Path(folder))
        except InputError as error:
            raise _foreign(path, str(error).partition("\n")[0].replace(folder, "")) from None


def _first_byte(path: Path, info: zipfile.ZipInfo) -> int:
    with path.open("rb") as file:
        file.seek(info.header_offset)
        header = file.read(LOCAL_HEADER)
    if len(header) < LOCAL_HEADER:
        raise BadArchive(f"{path}: cut short", found=f"{path.stat().st_size} bytes", fix=REPACK)
    return info.header_offset + LOCAL_HEADER + sum(LENGTHS.unpack(header))


def _foreign(path: Path, found: str) -> BadArchive:
    return BadArchive(f"{path}: not an archive that `hydroviews pack` wrote", found=found, fix=REPACK)
