import os
import re
import tarfile

import numpy as np
import pytest
from capture_archives import FILES, SCENE, contents, write_tar, write_zip

from hydroviews.captures.download import archives
from hydroviews.captures.download.archives import BadArchive, is_archive, unpack
from hydroviews.errors import InputError

WRITERS = {"a.zip": write_zip, "a.tar.gz": write_tar}


@pytest.fixture(params=WRITERS)
def kind(request, tmp_path):
    """Writes an archive of one kind."""
    (tmp_path / "archives").mkdir()
    return lambda files, links=(): WRITERS[request.param](tmp_path / "archives" / request.param, files, links)


def test_an_interrupted_call_is_gone_on_with(kind, tmp_path, monkeypatch):
    archive, folder, written = kind(FILES), tmp_path / "train", []
    real = archives.replacing

    def once(path):
        if written:
            raise KeyboardInterrupt
        written.append(path.name)
        return real(path)

    monkeypatch.setattr(archives, "replacing", once)
    with pytest.raises(KeyboardInterrupt):
        unpack(archive, "train", folder)
    assert not folder.exists()
    monkeypatch.setattr(archives, "replacing", lambda path: written.append(path.name) or real(path))
    unpack(archive, "train", folder)
    assert sorted(written) == ["a.jpg", "b.jpg", "cameras.bin"]  # each once
    assert contents(folder) == SCENE
    assert {path.name for path in tmp_path.iterdir()} == {"archives", "train"}


def test_files_of_another_version_are_not_kept(kind, tmp_path, monkeypatch):
    real = os.replace

    def refuses_folders(source, target):
        if os.path.isdir(source):
            raise KeyboardInterrupt
        real(source, target)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(archives.os, "replace", refuses_folders)
        unpack(kind(FILES), "train", tmp_path / "train", "one")
    changed = {**FILES, "tandt/train/images/a.jpg": b"FIRST"}
    unpack(kind(changed), "train", tmp_path / "train", "two")
    assert contents(tmp_path / "train") == {**SCENE, "images/a.jpg": b"FIRST"}


@pytest.mark.parametrize(
    ("links", "scene", "message"),
    [
        (["tandt/train/images/c.jpg"], "train", r"unpacked safely\n.*a link: 'tandt/train/images/c.jpg'"),
        ([], "horse", r"no folder horse in it\n.*tandt"),
    ],
)
def test_links_and_an_archive_without_the_scene_are_refused(kind, tmp_path, links, scene, message):
    with pytest.raises(InputError, match=message):
        unpack(kind(FILES, links), scene, tmp_path / scene)
    assert not (tmp_path / scene).exists()


def test_an_encrypted_file_is_refused(tmp_path):
    archive = write_zip(tmp_path / "a.zip", FILES)
    content = bytearray(archive.read_bytes())
    for entry in re.finditer(rb"PK\x01\x02", archive.read_bytes()):
        content[entry.start() + 8] |= 1  # the flag in the table at the end
    archive.write_bytes(content)
    with pytest.raises(BadArchive, match=r"an encrypted file: 'tandt/train/images/a\.jpg'"):
        unpack(archive, "train", tmp_path / "train")


OUTSIDE = ("../../outside.txt", "/outside.txt", "tandt/train/../../../outside.txt", "tandt\\train\\a", "C:/train/a")
UNSAFE = {
    **{(*FILES, name): r"cannot be unpacked safely\n.*leads outside" for name in OUTSIDE},
    ("train/a", "train/a/b"): "a file and a folder of one name: 'train/a'",
    ("train/a/b/c", "train/a"): "a file and a folder of one name: 'train/a'",
    ("train/" + 256 * "n",): "a name too long for a file: 'train/nnn",
}


@pytest.mark.parametrize(("names", "message"), UNSAFE.items(), ids=lambda value: value[-1][:30])
def test_names_that_lead_outside_or_meet_are_refused(kind, tmp_path, names, message):
    with pytest.raises(BadArchive, match=message):
        unpack(kind(dict.fromkeys(names, b"evil")), "train", tmp_path / "captures" / "train")
    assert not (tmp_path / "captures" / "train").exists()
    assert not (tmp_path / "outside.txt").exists()


@pytest.mark.parametrize("suffix", ["zip", "tar", "tar.gz", "tar.bz2", "tar.xz"])
def test_damage_anywhere_is_told_plainly(tmp_path, suffix):
    random = np.random.default_rng(0)
    archive, file = tmp_path / f"a.{suffix}", tmp_path / "file"
    file.write_bytes(random.bytes(400))
    if suffix == "zip":
        write_zip(archive, {"train/a": file.read_bytes()})
    else:
        with tarfile.open(archive, f"w:{suffix.partition('.')[2]}") as opened:
            opened.add(file, "train/a")
    whole, refused = archive.read_bytes(), 0
    for place in random.permutation(min(len(whole), 600))[:60]:
        archive.write_bytes(whole[:place] + random.bytes(4) + whole[place + 4 :])
        is_archive(archive)
        try:
            unpack(archive, "train", tmp_path / f"train-{place}")
        except BadArchive:
            refused += 1
            assert not (tmp_path / f"train-{place}").exists()
    assert refused > 5


def test_what_is_no_archive(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"<html>sign in first</html>")
    assert not is_archive(tmp_path / "a.zip")
    with pytest.raises(InputError, match="neither a zip nor a tar archive"):
        unpack(tmp_path / "a.zip", "train", tmp_path / "train")
