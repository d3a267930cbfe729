import hashlib
from dataclasses import replace

import pytest
from capture_archives import FILES, SCENE, contents, write_zip
from servers import serving

from hydroviews.captures.catalogue.catalogue import Archive, find_captures
from hydroviews.captures.download import captures as downloads
from hydroviews.captures.download.captures import addresses, download_captures, get_archive
from hydroviews.errors import InputError


@pytest.fixture(autouse=True)
def no_mirror_of_this_machine(plain_network, monkeypatch):
    monkeypatch.delenv(downloads.VARIABLE, raising=False)


@pytest.fixture
def content(tmp_path_factory):
    return write_zip(tmp_path_factory.mktemp("made") / "made.zip", FILES).read_bytes()


@pytest.fixture
def mirror(content):
    with serving({"/data/tandt_db.zip": content}) as server:
        yield server


@pytest.fixture
def archive(mirror):
    """The catalogue's entry of an archive, with the mirror as its address."""
    return Archive("tandt_db.zip", (f"{mirror.address}/data/tandt_db.zip",), 1)


def test_a_capture_is_downloaded_from_a_mirror_and_kept(mirror, content, tmp_path, monkeypatch):
    monkeypatch.setenv(downloads.VARIABLE, f"{mirror.address}/data/tandt_db.zip")
    (folder,) = download_captures("train", tmp_path)
    assert folder == tmp_path / "tandt" / "train"
    unpacked, digest = contents(folder), hashlib.sha256(content).hexdigest()
    source = unpacked.pop("SOURCE.md").decode()
    assert "https://www.tanksandtemples.org" in source
    assert digest in source
    assert unpacked == SCENE
    assert (tmp_path / "downloads" / "tandt_db.zip.sha256").read_text() == f"{digest}  tandt_db.zip\n"
    assert list(download_captures("tanksandtemples/train", tmp_path, "http://nowhere")) == [folder]
    (other,) = download_captures("truck", tmp_path)  # from the archive that is there
    assert (other / "images" / "a.jpg").read_bytes() == b"another scene"
    assert len(mirror.asked) == 1


def test_a_folder_of_the_users_where_a_capture_goes_stays(mirror, tmp_path):
    mine = tmp_path / "tandt" / "train" / "notes.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    assert list(download_captures("train", tmp_path, f"{mirror.address}/data")) == [mine.parent]
    assert [path.read_text() for path in mine.parent.iterdir()] == ["mine"]
    assert mirror.asked == []


def test_the_first_checksum_holds(mirror, archive, content, tmp_path):
    path = tmp_path / "tandt_db.zip"
    first = get_archive(archive, path)
    assert get_archive(archive, path) == first
    path.write_bytes(content + b"\0")
    with pytest.raises(InputError, match=r"wrong checksum[\s\S]*tandt_db\.zip\.sha256"):
        get_archive(archive, path)
    path.unlink()
    mirror.files["/data/tandt_db.zip"] = content + b"\0"
    with pytest.raises(InputError, match=f"wrong checksum .*, expected {first}"):
        get_archive(archive, path)


def test_after_a_bad_download_the_same_command_succeeds(mirror, content, tmp_path):
    at = content.index(b"images/a.jpg") + 14  # in what is packed: the table at the end is whole
    mirror.files["/data/tandt_db.zip"] = content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]
    with pytest.raises(InputError, match=r"damaged[\s\S]*delete it and run the same command again"):
        list(download_captures("train", tmp_path, f"{mirror.address}/data"))
    (tmp_path / "downloads" / "tandt_db.zip").unlink()
    mirror.files["/data/tandt_db.zip"] = content
    (folder,) = download_captures("train", tmp_path, f"{mirror.address}/data")
    assert contents(folder).items() >= SCENE.items()


def test_the_catalogues_checksum_comes_first(archive, content, tmp_path):
    with pytest.raises(InputError, match="wrong checksum"):
        get_archive(replace(archive, sha256="0" * 64), tmp_path / "tandt_db.zip")
    get_archive(replace(archive, sha256=hashlib.sha256(content).hexdigest()), tmp_path / "tandt_db.zip")
    assert not (tmp_path / "tandt_db.zip.sha256").exists()


def test_a_page_of_text_is_not_locked_in(mirror, archive, tmp_path):
    mirror.files["/page"] = b"<html>sign in first</html>"
    page = f"{mirror.address}/page"
    with pytest.raises(InputError, match="no zip or tar archive"):
        get_archive(replace(archive, urls=(page,)), tmp_path / "a.zip")
    assert contents(tmp_path) == {}
    get_archive(replace(archive, urls=(page, *archive.urls)), tmp_path / "a.zip")


def test_a_mirror_comes_before_the_catalogue():
    archive = find_captures("garden")[0].archive
    assert addresses(archive) == list(archive.urls)
    assert addresses(archive, "https://here/x") == ["https://here/x/360_v2.zip", *archive.urls]
    assert addresses(archive, "https://here/y.tar") == ["https://here/y.tar", *archive.urls]
    for odd in ("/mnt/data", "http://[half"):
        with pytest.raises(InputError, match="not an address"):
            addresses(archive, odd)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("horse", r"horse is not on this machine[\s\S]*has no horse"),
        ("waterdrops/church", r"network drive[\s\S]*github.com/yunhaoli2020/DerainNeRF"),
        ("moon", "no such capture to download"),
    ],
)
def test_what_has_to_be_fetched_by_hand_is_told(tmp_path, name, message):
    with pytest.raises(InputError, match=message):
        list(download_captures(name, tmp_path))


def test_a_collection_comes_whole_before_what_is_for_hands(mirror, tmp_path):
    with pytest.raises(InputError, match="has no horse"):
        list(download_captures("tanksandtemples", tmp_path, f"{mirror.address}/data/"))
    assert {path.name for path in (tmp_path / "tandt").iterdir()} == {"train", "truck"}
