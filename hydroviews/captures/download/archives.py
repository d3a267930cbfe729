"""One scene's files out of a zip or tar archive: nothing else, nothing outside its folder, whole or not there."""

import copy
import errno
import gzip
import lzma
import os
import shutil
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.files.full_disk import plain_write_errors
from hydroviews.files.temporary import UNFINISHED

DEPTH = 3  # how far down an archive the scene's folder may be
LONGEST = 255  # bytes of a name, on every common file system
ANOTHER = "delete it and run the same command again, or ask its authors"
ENCRYPTED = 1  # zip's flag
BLOCK = 1 << 20  # bytes
DAMAGE = (
    zipfile.BadZipFile,
    tarfile.TarError,
    gzip.BadGzipFile,
    lzma.LZMAError,
    zlib.error,
    EOFError,
    NotImplementedError,
    UnicodeDecodeError,  # of a name
)
DAMAGED = (None, errno.EINVAL)  # errors of bz2 and gzip, and of a zip whose table points before its beginning


class BadArchive(InputError):
    """An archive that no scene can be taken from."""


@dataclass(frozen=True)
class Member:
    """A file in an archive."""

    name: str
    size: int
    link: bool
    encrypted: bool
    entry: zipfile.ZipInfo | tarfile.TarInfo


Opened = zipfile.ZipFile | tarfile.TarFile


def is_archive(path: Path) -> bool:
    """Whether a file is a zip or tar archive, as far as its beginning tells."""
    try:
        return zipfile.is_zipfile(path) or tarfile.is_tarfile(path)
    except DAMAGE:
        return False


def unpack(archive: Path, scene: str, folder: Path, label: str = "") -> None:
    """Unpack the files below the archive's folder `scene` to `folder`, which appears once it is complete.

    A call resumes where an interrupted one ended.

    Args:
        archive: zip, or tar with any compression.
        scene: name of a folder in it, at most DEPTH folders down.
        folder: must not exist, or be empty.
        label: identifies the archive's version; files of an interrupted call are kept for the same one only.

    Raises:
        BadArchive: it is damaged or encrypted, lacks the scene, or has links or names that lead outside.
        InputError: the disk is full, or the folder may not be written.
    """
    staging = folder.with_name(f"{UNFINISHED}{label}-{folder.name}")
    with opened_archive(archive) as opened:
        files = _scene_files(archive, _members(opened), scene)
        missing = {path: member for path, member in files.items() if not _is_there(staging / path, member)}
        refuse_if_too_large(folder, sum(member.size for member in missing.values()))
        with tqdm(
            total=sum(member.size for member in files.values()),
            initial=sum(member.size for path, member in files.items() if path not in missing),
            desc=f"unpacking {scene}",
            unit="B",
            unit_scale=True,
        ) as bar:
            for path, member in missing.items():
                _write(opened, member, staging / path)
                bar.update(member.size)
    with plain_write_errors(folder):
        os.replace(staging, folder)


@contextmanager
def opened_archive(archive: Path) -> Iterator[Opened]:
    """The open archive; damage found while it is read raises InputError."""
    try:
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as opened:
                yield opened
        else:
            with tarfile.open(archive) as opened_tar:
                yield opened_tar
    except (*DAMAGE, OSError) as error:
        if isinstance(error, OSError) and error.errno not in DAMAGED:
            raise
        raise BadArchive(
            f"{archive}: damaged, or neither a zip nor a tar archive",
            found=f"{archive.stat().st_size} bytes; {error}",
            fix="delete it and run the same command again",
        ) from error


def _members(opened: Opened) -> list[Member]:
    if isinstance(opened, zipfile.ZipFile):
        return [
            Member(
                info.filename,
                info.file_size,
                link=stat.S_ISLNK(info.external_attr >> 16),
                encrypted=bool(info.flag_bits & ENCRYPTED),
                entry=info,
            )
            for info in opened.infolist()
            if not info.is_dir()
        ]
    members = opened.getmembers()
    while opened.fileobj and opened.fileobj.read(BLOCK):  # a compressed file's checksum stands at its end
        pass
    files = [info for info in members if not info.isdir()]
    return [Member(info.name, info.size, link=not info.isfile(), encrypted=False, entry=info) for info in files]


def _scene_files(archive: Path, members: list[Member], scene: str) -> dict[PurePosixPath, Member]:
    """The scene's files by their paths below its folder; hidden ones are left out."""
    found: dict[PurePosixPath, dict[PurePosixPath, Member]] = {}
    for member in members:
        parts = safe_parts(archive, member.name)
        if scene not in parts[:DEPTH]:
            continue
        inside = parts.index(scene) + 1
        if inside == len(parts) or any(part.startswith((".", "__MACOSX")) for part in parts):
            continue
        if member.link or member.encrypted:
            raise refused(archive, member.name, "a link" if member.link else "an encrypted file")
        found.setdefault(PurePosixPath(*parts[:inside]), {})[PurePosixPath(*parts[inside:])] = member
    if not found:
        folders = sorted({PurePosixPath(member.name).parts[0] for member in members if member.name})
        raise BadArchive(f"{archive}: no folder {scene} in it", found=", ".join(folders[:12]) or "nothing")
    files = found[min(found, key=lambda prefix: (len(prefix.parts), str(prefix)))]
    for folder in {parent for path in files for parent in path.parents} & files.keys():
        raise refused(archive, files[folder].name, "a file and a folder of one name")
    return files


def safe_parts(archive: Path, name: str, fix: str = ANOTHER) -> tuple[str, ...]:
    """The parts of a member's path; `fix` is what to do about one that is refused.

    Checked here, because the libraries unpack where this refuses: zipfile drops `..` from a name without a word, and
    tarfile's data filter a leading slash.
    """
    parts = PurePosixPath(name).parts
    if not parts or ".." in parts or parts[0] == "/" or "\\" in name or "\0" in name or ":" in parts[0]:
        raise refused(archive, name, "a name that leads outside", fix)
    if any(len(os.fsencode(part)) > LONGEST for part in parts):
        raise refused(archive, name[:LONGEST], "a name too long for a file", fix)
    return parts


def refused(archive: Path, name: str, what: str, fix: str = ANOTHER) -> BadArchive:
    """The error for a member that is no plain file with a name of its own."""
    return BadArchive(f"{archive}: cannot be unpacked safely", found=f"{what}: {name!r}", fix=fix)


def _is_there(path: Path, member: Member) -> bool:
    return path.is_file() and path.stat().st_size == member.size


def refuse_if_too_large(folder: Path, needed: int) -> None:
    """Refuse to fill the disk.

    Raises:
        InputError: the disk that `folder` is on has fewer than `needed` bytes free.
    """
    with plain_write_errors(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(folder.parent).free
    if needed > free:
        raise InputError(
            f"{folder}: no space left on the disk",
            found=f"{free / 1e9:.1f} GB free",
            expected=f"{needed / 1e9:.1f} GB",
            fix="free some space and run the same command again",
        )


def _write(opened: Opened, member: Member, path: Path) -> None:
    """Extract a member to `path`, whole or not at all; the archive's modes, owners and times are not taken over."""
    with replacing(path) as temporary:
        if isinstance(opened, zipfile.ZipFile) and isinstance(member.entry, zipfile.ZipInfo):
            renamed = copy.copy(member.entry)
            renamed.filename = temporary.name
            opened.extract(renamed, temporary.parent)
        elif isinstance(opened, tarfile.TarFile) and isinstance(member.entry, tarfile.TarInfo):
            entry = member.entry.replace(name=temporary.name, mode=None, mtime=None, deep=False)  # type: ignore[arg-type]
            opened.extract(entry, temporary.parent, filter="data")
