"""What is packed, what the licence allows, and that builds at work are waited for."""

import json
import os
import shutil
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from shared_data_set import built_in, facts_of

from hydroviews.__main__ import download_command, pack_command
from hydroviews.dataset.manifest import record_scene
from hydroviews.dataset.sharing.archive import open_archive
from hydroviews.dataset.sharing.contents import APACHE_TEXT, is_ours
from hydroviews.dataset.sharing.fetch import fetch
from hydroviews.dataset.sharing.pack import pack
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.files.locks import locked
from hydroviews.rain.patterns import PATTERN_FILE

ROOT = Path(__file__).parents[4]


@pytest.fixture
def silent(tmp_path):
    """A scene whose capture states no licence."""
    return built_in(tmp_path, says=None)


@pytest.mark.parametrize("says", [None, {"licence": "my own"}, {"licence": "CC-BY-4.0", "shareable": False}])
def test_what_may_not_be_handed_on_is_refused(tmp_path, says):
    built = built_in(tmp_path, says=says)
    with pytest.raises(InputError, match="does not allow to hand them on"):
        list(pack(built, tmp_path / "out"))
    assert not list(tmp_path.glob("out/*.zip"))


def test_an_archive_for_every_variant_and_one_for_the_clean_views(built, tmp_path):
    paths = [path for path, _ in pack(built.parent, tmp_path)]
    assert sorted(path.name for path in paths) == ["yard-clean.zip", "yard-storm-1.zip", "yard-streak-1.zip"]
    for path in paths:
        names = {name.partition("/")[0] for name in open_archive(path).entry["files"]}
        assert names & {"storm-1", "streak-1"} == {path.stem.removeprefix("yard-")} - {"clean"}
        assert names >= {"clean", "sparse", "split.json", "README.md", "licence", "request.json"}
        assert str(built.parents[1]).encode() not in path.read_bytes()  # no local path


def test_the_same_data_give_the_same_bytes(built, tmp_path):
    """Whatever the folder, its times, the umask, and the variants beside it."""
    other = built_in(tmp_path / "moved", patterns=("streak-1",))
    for path in other.rglob("*"):
        if not path.is_symlink():
            os.utime(path, (1e9, 1e9))
    [(_, here)] = pack(built, tmp_path / "here", patterns=["streak-1"])
    before = os.umask(0o077)
    try:
        assert [digest for _, digest in pack(other, tmp_path / "there", patterns=["streak-1"])] == [here]
    finally:
        os.umask(before)


def test_what_nobody_could_unpack_is_not_packed(tmp_path):
    odd = built_in(tmp_path, patterns=(), name="walk-12:30")
    with pytest.raises(InputError, match=r"a name that leads outside: 'walk-12:30/.*\n.*rename"):
        next(pack(odd, tmp_path / "out"))
    assert not list(tmp_path.glob("out/*"))


def test_remarks_that_name_a_folder_of_this_machine_stay_here(tmp_path):
    """Neither manifest nor card says them, whoever made the remark; the others are packed."""
    built = built_in(tmp_path, patterns=("streak-1",))
    own = ("read from /home/me/My Photos/yard; mine is ./yard", "see 'C:\\Users\\me\\yard'.", "9 of 9/10 images")
    record_scene(built.parent, "yard", facts_of(built) | {"notes": own})
    [(path, digest)] = pack(built, tmp_path / "out", patterns=["streak-1"])
    packed = path.read_bytes()
    assert b"9 of 9/10 images" in packed
    assert b"My Photos" not in packed
    assert b"Users" not in packed
    assert open_archive(path).entry["notes"] == ["9 of 9/10 images"]
    again = fetch(str(path), tmp_path / "fetched")
    assert [digest] == [other for _, other in pack(again, tmp_path / "again", patterns=["streak-1"])]


def test_what_is_there_is_left_if_it_is_the_same(built, tmp_path):
    for _ in range(2):
        list(pack(built, tmp_path / "one.zip", patterns=["streak-1"]))
    for out, patterns, message in (
        ("one.zip", ["storm-1"], "another archive is there"),
        ("all.zip", (), "one archive, for 3 variants"),
        (".", ["streak-2"], "no such variant"),
    ):
        with pytest.raises(InputError, match=message):
            list(pack(built, tmp_path / out, patterns=patterns))


def test_the_owner_states_the_licence(silent, tmp_path):
    assert "licence is unknown" in (silent / "README.md").read_text()
    [(path, _)] = pack(silent, tmp_path / "out", patterns=["streak-1"], owner_says="CC-BY-SA-4.0")
    with zipfile.ZipFile(path) as opened:
        stated = json.loads(opened.read("yard/licence/licence.json"))
        assert "as stated by who packed it: CC-BY-SA-4.0" in opened.read("yard/README.md").decode()
    assert stated == {"text": "CC-BY-SA-4.0", "shareable": True, "said_by": "who packed it"}
    metadata = json.loads(path.with_suffix(".croissant.json").read_text())
    assert metadata["license"] == "https://spdx.org/licenses/CC-BY-SA-4.0"


def test_our_own_licence_text_is_the_one_of_the_repository():
    assert APACHE_TEXT.read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_layers_alone_hold_no_picture_of_the_capture(silent, tmp_path):
    """Planes R, G and B of a storm are made from the photographs; streaks are not."""
    archives = {path.stem: open_archive(path) for path, _ in pack(silent, tmp_path / "out", layers_only=True)}
    streak, storm = archives["yard-streak-1-layers"], archives["yard-storm-1-layers"]
    assert {Path(name).suffix for name in storm.places} == {".json", ".csv", ".md"}
    assert sum(name.startswith("streak-1/layers/") for name in streak.places) == 9
    assert not any(name.endswith(".png") or "sparse" in name for name in (*streak.places, *storm.places))


@pytest.mark.parametrize(
    ("effect", "picture"),
    [("raindrop-b", True), ("shower", True), ("window", True), ("streak-b", False), ("dark", False), ("haze", False)],
)
def test_layers_that_show_the_scene_go_with_its_licence(silent, effect, picture):
    """Whatever the effect calls its planes of added light."""
    layer = f"{effect}-1/layers/a.exr"
    (silent / f"{effect}-1").mkdir()
    write_json(silent / f"{effect}-1" / PATTERN_FILE, {"effect": effect})
    assert is_ours(silent, layer, [f"{effect}-1"], shareable=False) != picture
    assert is_ours(silent, layer, [f"{effect}-1"], shareable=True)


def test_a_build_at_work_is_waited_for(built, tmp_path):
    with ThreadPoolExecutor() as other:
        with locked(built):
            packing = other.submit(lambda: list(pack(built, tmp_path, patterns=["clean"])))
            time.sleep(0.5)
            assert not packing.done()
        assert len(packing.result()) == 1


def test_what_is_not_finished_is_refused(tmp_path):
    built = built_in(tmp_path)
    record_scene(built.parent, "yard", facts_of(built) | {"patterns": ["streak-1"]})  # the storm is being drawn
    with pytest.raises(InputError, match="storm-1: its build is not finished"):
        list(pack(built, tmp_path / "out", patterns=["storm-1"]))
    shutil.copytree(built, built.with_name("begun"))
    with pytest.raises(InputError, match="begun: its build is not finished"):
        list(pack(built.parent, tmp_path / "out"))


@pytest.mark.parametrize(("place", "kinds"), [("beside", ("rainy", "clean", "layers")), ("inside", ("rainy", "clean"))])
def test_other_software_reads_the_metadata(built, tmp_path, place, kinds):
    """mlcroissant validates them, and finds every view in the files that they point to, but no EXR on the disk."""
    mlcroissant = pytest.importorskip("mlcroissant", reason="the extra `sharing` is not installed")
    [(path, _)] = pack(built, tmp_path / "out", patterns=["streak-1"])
    metadata = path.with_suffix(".croissant.json")
    if place == "inside":
        with zipfile.ZipFile(path) as opened:
            opened.extractall(tmp_path / "unpacked")
        metadata = tmp_path / "unpacked" / "croissant.json"
    dataset = mlcroissant.Dataset(str(metadata))
    assert not dataset.metadata.ctx.issues.errors
    views = {record["views/name"]: record["views/split"] for record in dataset.records("views")}
    assert list(views.values()).count("test") == 2
    assert [len(list(dataset.records(kind))) for kind in kinds] == [9] * len(kinds)


def test_the_commands(built, tmp_path, capsys):
    pack_command(built, tmp_path / "out", patterns=("streak-1",))
    digest, path = capsys.readouterr().out.split()
    download_command(f"{path}#sha256={digest}", out=tmp_path / "data")
    assert capsys.readouterr().out == f"ready: {tmp_path / 'data' / 'yard'}\n"
    with pytest.raises(InputError, match="wrong checksum"):
        download_command(f"{path}#sha256={'0' * 64}", out=tmp_path / "data")
