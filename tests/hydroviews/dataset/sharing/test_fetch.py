"""What is fetched is what was built: to `verify`, to who opens it, and to the hash in a run's record."""

from unittest.mock import Mock

import numpy as np
import pytest
from capture_archives import contents
from servers import serving
from shared_data_set import built_in, facts_of

from hydroviews.captures.download.archives import BadArchive
from hydroviews.dataset.card.card import LOSSES
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import data_hash, forget_scene, record_scene
from hydroviews.dataset.sharing import archive as archive_module
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.ownership import left_by_others

pytestmark = pytest.mark.usefixtures("plain_network")


def visible(data):
    return sorted(path.name for path in data.glob("[!.]*"))


def test_one_variant_in_an_empty_folder_is_a_data_set(built, archive, tmp_path):
    data = tmp_path / "data"
    folder = fetch(str(archive), data)
    assert verify(data, every_view=True) == []
    for pattern in ("streak-1", "clean"):
        assert data_hash(data, "yard", pattern) == data_hash(built.parent, "yard", pattern)
    ours, theirs = (open_variant(scene, "streak-1").views[0].image() for scene in (folder, built))
    assert np.array_equal(ours, theirs)
    assert len(open_clean(folder).test_views) == 2
    with pytest.raises(InputError, match="no such views"):
        open_variant(folder, "storm-1")
    assert (folder / "clean" / "view-00.png").stat().st_mode & 0o222 == 0


def test_variants_fetched_one_by_one_are_the_scene_that_was_built(built, archives, tmp_path):
    data = tmp_path / "data"
    for path in archives.values():
        fetch(str(path), data)
    assert verify(data, every_view=True) == []
    assert left_by_others(data / "yard") == []
    built, fetched = contents(built), contents(data / "yard")
    only_fetched = {"licence/licence.json"} & (fetched.keys() - built.keys())
    assert fetched.keys() - only_fetched == {name for name in built if "/." not in f"/{name}"}
    differing = {name for name in fetched.keys() & built.keys() if fetched[name] != built[name]}
    assert differing <= {"request.json"}  # which names no local path any more
    again = {path.name: path.read_bytes() for path, _ in pack(data, tmp_path / "again")}
    assert again == {path.name: path.read_bytes() for path in archives.values()}
    assert len(again) == 3


def test_another_scene_of_that_name_is_refused_and_stays(archives, tmp_path):
    other = built_in(tmp_path, patterns=("streak-1",), seed=7)
    before = contents(other)
    for path in archives.values():
        with pytest.raises(InputError, match="not the scene of the archive"):
            fetch(str(path), other.parent)
    assert contents(other) == before


def test_a_missing_file_is_made_good_and_a_changed_one_not_covered_up(archives, archive, tmp_path):
    folder = fetch(str(archive), tmp_path / "data")
    view = folder / "clean" / "view-01.png"
    view.unlink()
    fetch(str(archive), tmp_path / "data")
    assert verify(tmp_path / "data") == []
    view.unlink()
    view.write_bytes(b"other")
    with pytest.raises(InputError, match=r"clean/view-01\.png"):
        fetch(str(archives["storm-1"]), tmp_path / "data")


def test_a_build_that_is_not_finished_is_not_touched(archive, tmp_path):
    built = built_in(tmp_path)
    forget_scene(built.parent, "yard")
    (built / "storm-1" / "images" / "view-08.png").unlink()
    with pytest.raises(InputError, match="a scene whose build is not finished"):
        fetch(str(archive), built.parent)


@pytest.mark.parametrize("stop", [0, 3, 20])
def test_an_interrupted_unpacking_goes_on(archive, tmp_path, monkeypatch, stop):
    data, copies = tmp_path / "data", []
    copy = archive_module.Packed.copy

    def interrupted(self, name, target):
        copies.append(name)
        if len(copies) == stop + 1:
            target.write_bytes(b"half of it")
            raise KeyboardInterrupt
        copy(self, name, target)

    monkeypatch.setattr(archive_module.Packed, "copy", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fetch(str(archive), data)
    assert visible(data) == []
    fetch(str(archive), data)
    assert verify(data) == []
    assert len(copies) == len(set(copies)) + 1  # the one that was interrupted, twice
    assert not list(data.glob(".partial-fetched-*"))


@pytest.mark.parametrize("stop", ["write_card", "enter_scene", "link_shared"])
def test_an_interruption_after_unpacking_is_made_good(archives, archive, tmp_path, monkeypatch, stop):
    for path in (archive, archives["storm-1"]):
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(f"hydroviews.dataset.sharing.fetch.{stop}", Mock(side_effect=KeyboardInterrupt))
            fetch(str(path), tmp_path / "data")
        fetch(str(path), tmp_path / "data")
        assert verify(tmp_path / "data") == []


def test_a_later_call_goes_on_with_a_download(archive, tmp_path):
    with serving({"/a.zip": archive.read_bytes()}, cut_after=[50_000, 0, 0, 0]) as server:
        with pytest.raises(InputError, match="no server delivers it"):
            fetch(f"{server.address}/a.zip", tmp_path / "data")
        server.asked.clear()
        fetch(f"{server.address}/a.zip", tmp_path / "data")
        assert server.asked == [("/a.zip", "bytes=50000-")]
    assert verify(tmp_path / "data") == []


def test_a_download_that_is_no_archive_of_ours_is_not_kept_for_the_next_call(archive, tmp_path):
    content, data = archive.read_bytes(), tmp_path / "data"
    damaged = bytearray(content)
    damaged[len(content) // 2] ^= 1
    with serving({"/a.zip": content, "/page.zip": b"<html>", "/b.zip": bytes(damaged)}) as server:
        for name, error, fault in (
            (f"a.zip#sha256={'0' * 64}", InputError, r"wrong checksum .* as the address says"),
            ("page.zip", InputError, "a page of text"),
            ("b.zip", BadArchive, "not what the manifest says"),
        ):
            with pytest.raises(error, match=fault):
                fetch(f"{server.address}/{name}", data)
        assert visible(data) == []
        server.files["/b.zip"] = content
        fetch(f"{server.address}/b.zip", data)
    assert verify(data) == []


def test_layers_alone_make_the_rainy_views_where_the_clean_ones_are(tmp_path):
    """Somebody else with the same capture gets the very same variant; what the owner measured is not part of it."""
    built = built_in(tmp_path / "mine", says=None)
    (built / LOSSES).write_text("pattern,grade,track,clean,rainy,loss,seeds\nstorm-1,medium,given-poses,30,28,2,0\n")
    record_scene(built.parent, "yard", facts_of(built))
    [(path, _)] = pack(built, tmp_path / "out", patterns=["streak-1"], layers_only=True)
    theirs = built_in(tmp_path / "theirs", patterns=("storm-1",), says=None)
    fetch(str(path), theirs.parent)
    assert data_hash(theirs.parent, "yard", "streak-1") == data_hash(built.parent, "yard", "streak-1")
    assert verify(theirs.parent, every_view=True) == []


def test_layers_alone_need_the_capture(tmp_path):
    built = built_in(tmp_path, says=None, patterns=("streak-1",))
    [(path, _)] = pack(built, tmp_path / "out", layers_only=True)
    missing = rf"leaves out .* files that are not here either(.|\n)*--out {tmp_path / 'empty'} .*--patterns streak-1"
    with pytest.raises(InputError, match=missing):
        fetch(str(path), tmp_path / "empty")
    assert visible(tmp_path / "empty") == []
