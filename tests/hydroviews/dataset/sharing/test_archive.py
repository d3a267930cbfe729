"""Archives that are damaged, or made to do harm, are refused; good ones have the same bytes everywhere."""

import hashlib
import json
import os
import stat
import zipfile

import pytest
from shared_data_set import member, rewritten

from hydroviews.dataset.sharing.archive import open_archive, write_archive
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.errors import InputError


def refused(path, tmp_path, match):
    with pytest.raises(InputError, match=match):
        fetch(str(path), tmp_path / "data")
    assert list((tmp_path / "data").glob("[!.]*")) == [], "nothing may look finished"


def test_bytes_are_the_same_on_every_machine(tmp_path):
    """The known answer: no time, mode, order or system of this machine is in it."""
    file = tmp_path / "b.bin"
    file.write_bytes(bytes(range(256)) * 9000)  # several blocks
    os.chmod(file, 0o400)
    parts, digest = {"a.json": b"{}\n", "ä/b.bin": file}, hashlib.sha256(file.read_bytes()).hexdigest()
    found = write_archive(tmp_path / "x.zip", "x.zip", parts, {"ä/b.bin": digest})
    assert found == "bf97e81fa0f4a2ada20dc677bee382715d7edf5ffe05dc022e45c101774e79b4"
    with pytest.raises(InputError, match="changed since it was built"):
        write_archive(tmp_path / "x.zip", "x.zip", parts, {"ä/b.bin": hashlib.sha256(b"built").hexdigest()})


@pytest.mark.parametrize("share", [0.999, 0.5, 0.01, 0])
def test_an_archive_cut_short(archive, tmp_path, share):
    content = archive.read_bytes()
    (tmp_path / "cut.zip").write_bytes(content[: int(share * len(content))])
    refused(tmp_path / "cut.zip", tmp_path, "damaged")


def test_a_changed_byte_anywhere_is_refused_or_does_no_harm(archive, tmp_path):
    """In headers, members, the directory and the end: what is unpacked always is what was packed."""
    content, whole = archive.read_bytes(), open_archive(archive)
    directory = content.index(b"PK\x01\x02")
    spots = [*range(0, directory, directory // 40), *range(directory, len(content), 89), len(content) - 22]
    harmless = 0
    for spot in spots:
        spoilt = tmp_path / "spoilt.zip"
        spoilt.write_bytes(content[:spot] + bytes([content[spot] ^ 0x55]) + content[spot + 1 :])
        try:
            packed = open_archive(spoilt)
            assert packed.entry == whole.entry
            for name in packed.places:
                assert b"".join(packed.blocks(name)) == b"".join(whole.blocks(name))
            harmless += 1
        except InputError:
            pass
    assert harmless < len(spots) / 2


def with_manifest(**changes):
    """A change of members: the scene's entry in the manifest is changed."""

    def changed(members):
        (info, content), *others = members
        manifest = json.loads(content)
        entry = manifest["scenes"]["yard"]
        entry |= changes | {"files": entry["files"] | changes.get("files", {})}
        return [(info, json.dumps(manifest).encode()), *others]

    return changed


def with_facts(members):
    """The pattern's facts are others, of which the manifest has the hash."""
    facts, name = json.dumps({"effect": "harm.Boom", "parameters": {}}).encode(), "streak-1/pattern.json"
    members = with_manifest(files={name: hashlib.sha256(facts).hexdigest()})(members)
    return [(info, facts if info.filename.endswith(name) else content) for info, content in members]


def with_member(name):
    return lambda members: [*members, (member(name), b"harm")]


def of_mode(mode):
    """The third member is something that is no file."""
    return lambda members: [(member(members[2][0].filename, mode), b"/etc/passwd"), *members[:2], *members[3:]]


def bomb(members):
    """The third member is small only as long as it is packed."""
    info = member(members[2][0].filename)
    info.compress_type = zipfile.ZIP_DEFLATED
    return [*members[:2], (info, bytes(50_000_000)), *members[3:]]


OUTSIDE = ("../x", "yard/../../x", "/etc/x", "yard\\..\\x", "c:/x", "elsewhere/x")
MEETING = ("yard/clean/view-00.png", "YARD/clean/view-00.png", "yard/clean", "yard/new.png", "yard/clean/")
HARMFUL = {
    **{name: (with_member(name), "cannot be unpacked safely") for name in (*OUTSIDE, *MEETING)},
    **{
        f"boom.{end}": (with_member(f"yard/boom.{end}"), "a file that Python could import")
        for end in ("py", "PYC", "so", "abi3.so")
    },
    "a file outside": (with_manifest(files={"../x": "0" * 64}), "not an archive that `hydroviews pack"),
    "an effect": (with_manifest(patterns=["harm.Boom-0"]), r"installed here\n  found: harm\.Boom"),
    "an effect in the pattern": (with_facts, r"an effect that is not installed here\n  found: harm\.Boom"),
    "a link": (of_mode(stat.S_IFLNK | 0o777), "safely"),
    "a named pipe": (of_mode(stat.S_IFIFO | 0o644), "safely"),
    "no mode": (of_mode(0), "safely"),
    "a bomb": (bomb, "an encrypted or compressed file"),
    "no manifest": (lambda members: members[1:], "not an archive|incomplete"),
    "a file less": (lambda members: members[:5] + members[6:], "not an archive|incomplete"),
}


@pytest.mark.parametrize("name", HARMFUL)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_archive_that_could_do_harm(archive, tmp_path, monkeypatch, name):
    """Not even what lies in the folder where the command is started is imported."""
    (tmp_path / "harm.py").write_text("from pathlib import Path\nPath('was run').touch()\n")
    monkeypatch.chdir(tmp_path)
    change, message = HARMFUL[name]
    refused(rewritten(archive, tmp_path / "bad.zip", change), tmp_path, message)
    assert not (tmp_path / "was run").exists()


def test_members_that_overlap_are_no_more_than_the_archive(archive, tmp_path):
    content = bytearray(archive.read_bytes())
    at = content.index(b"PK\x01\x02", content.index(b"PK\x01\x02") + 4)
    content[at + 20 : at + 28] = (10**9).to_bytes(4, "little") * 2  # both of its sizes
    (tmp_path / "bad.zip").write_bytes(content)
    refused(tmp_path / "bad.zip", tmp_path, "more than the .* bytes of the archive")


def test_other_archives_and_no_archive(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as other:
        other.writestr(member("a.txt"), "hello")
    refused(tmp_path / "other.zip", tmp_path, r"1 files and no manifest\.json")
    refused(tmp_path / "absent.zip", tmp_path, "no such archive")
