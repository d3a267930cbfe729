"""Archives with scenes in them."""

import io
import stat
import tarfile
import zipfile

from hydroviews.files.ownership import LISTS

FILES = {
    "tandt/train/images/a.jpg": b"first",
    "tandt/train/images/b.jpg": b"second" * 1000,
    "tandt/train/sparse/0/cameras.bin": b"cameras",
    "tandt/train/.DS_Store": b"rubbish",
    "__MACOSX/tandt/train/images/._a.jpg": b"rubbish",
    "tandt/truck/images/a.jpg": b"another scene",
    "tandt/truck/notes/deep/train/c.jpg": b"a folder that happens to be called so",
}
SCENE = {"images/a.jpg": b"first", "images/b.jpg": b"second" * 1000, "sparse/0/cameras.bin": b"cameras"}


def write_zip(path, files, links=()):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
        for name in links:
            info = zipfile.ZipInfo(name)
            info.external_attr = (stat.S_IFLNK | 0o777) << 16
            archive.writestr(info, "/etc/passwd")
    return path


def write_tar(path, files, links=()):
    with tarfile.open(path, "w:gz") as archive:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
        for name in links:
            info = tarfile.TarInfo(name)
            info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
            archive.addfile(info)
    return path


def contents(folder):
    """The files of a folder, without those lists of ours that tell whose they are."""
    paths = [path for path in folder.rglob("*") if path.is_file() and path.name not in LISTS]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
