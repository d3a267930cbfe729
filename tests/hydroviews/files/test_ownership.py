import os
import shutil

import pytest
from in_the_way import swap

from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import edit_bytes, replacing, write_bytes


@pytest.fixture
def claimed(tmp_path):
    """A claimed folder with two files of ours, one of the user's, and one of a file manager's."""
    folder = tmp_path / "claimed"
    ownership.claim(folder)
    write_bytes(folder / "a.png", b"ours")
    write_bytes(folder / "below" / "b é\n.png", b"ours")
    (folder / "below" / "mine.txt").write_text("the user's")
    (folder / ".DS_Store").write_bytes(b"")
    return folder


def test_removing_leaves_what_is_not_ours(claimed):
    assert ownership.remove(claimed) == [claimed / "below" / "mine.txt"]
    assert (claimed / "below" / "mine.txt").read_text() == "the user's"
    assert not (claimed / "a.png").exists()
    assert [path.name for path in (claimed / "below").iterdir()] == ["mine.txt"]
    for others in (claimed / "below" / "mine.txt", claimed / ".DS_Store"):
        others.unlink()
    assert ownership.remove(claimed) == []
    assert not claimed.exists()


def test_the_list_goes_where_the_folder_goes(claimed, tmp_path):
    for there in (shutil.copytree(claimed, tmp_path / "copy"), claimed.rename(tmp_path / "moved")):
        assert ownership.left_by_others(there) == [there / "below" / "mine.txt"]


def test_a_file_of_the_users_is_never_written_over(claimed, caplog):
    write_bytes(claimed / "a.png", b"anew")
    write_bytes(claimed / "below" / "mine.txt", b"ours")
    write_bytes(claimed / "below" / "mine.txt", b"anew")
    assert (claimed / "a.png").read_bytes() == (claimed / "below" / "mine.txt").read_bytes() == b"anew"
    assert (claimed / "below" / "mine.txt.kept").read_text() == "the user's"
    assert "mine.txt: not written by HydroViews, and in the way: it is now called mine.txt.kept" in caplog.text
    assert ownership.left_by_others(claimed) == [claimed / "below" / "mine.txt.kept"]


def test_clearing_removes_nothing_where_something_is_not_ours(claimed):
    with pytest.raises(InputError, match=r"mine\.txt"):
        ownership.clear(claimed / "below")
    assert len(list((claimed / "below").iterdir())) == 2
    (claimed / "below" / "mine.txt").unlink()
    ownership.clear(claimed / "below")
    assert not (claimed / "below").exists()


def test_whole_folders_and_links_are_entered(claimed):
    with replacing(claimed / "model") as temporary:
        temporary.mkdir()
        (temporary / "cameras.bin").write_bytes(b"")
    (claimed / "model" / "mine.ply").write_bytes(b"")
    ownership.enter(claimed / "link")
    os.symlink(claimed / "a.png", claimed / "link")
    (claimed / "work.db").write_bytes(b"the user's")
    with pytest.raises(InputError, match=r"work\.db"):  # names that other programs will write must be free
        ownership.enter_all(["work.db"], claimed)
    (claimed / "work.db").unlink()
    ownership.enter_all(["work/", "work.db"], claimed)
    (claimed / "work").mkdir()
    for name in ("work/anything", "work.db"):
        (claimed / name).write_bytes(b"")
    left = [claimed / "below" / "mine.txt", claimed / "model" / "mine.ply"]
    assert ownership.left_by_others(claimed) == left
    assert ownership.remove(claimed) == left


def test_loose_outputs_are_known_again_and_others_refused(tmp_path):
    for _ in range(2):
        ownership.require_ours([tmp_path / "sheet.png"])
        write_bytes(tmp_path / "sheet.png", b"ours")
    (tmp_path / "holiday.png").write_bytes(b"the user's")
    with pytest.raises(InputError, match=r"holiday\.png: not written by HydroViews"):
        ownership.require_ours([tmp_path / "sheet.png", tmp_path / "holiday.png"])


def test_a_list_that_was_cut_short_is_read_as_far_as_it_goes(claimed):
    content = (claimed / ownership.FOLDER).read_bytes()
    (claimed / ownership.FOLDER).write_bytes(content[:-5])
    assert ownership.is_ours(claimed / "a.png")
    assert not ownership.is_ours(claimed / "below" / "b é\n.png")


def test_where_no_list_is_in_reach_the_first_file_begins_one(tmp_path, caplog):
    (tmp_path / "notes.md").write_text("the user's")
    for content in (b"the user's", b"ours", b"anew"):  # the same bytes are not in the way, and stay the user's
        write_bytes(tmp_path / "notes.md", content)
        assert (tmp_path / "notes.md").read_bytes() == content
        assert (tmp_path / "notes.md.kept").exists() == (content != b"the user's")
    assert (tmp_path / "notes.md.kept").read_text() == "the user's"
    assert caplog.text.count("notes.md: not written by HydroViews, and in the way") == 1


@pytest.mark.parametrize("kind", ["folder", "named pipe"])
def test_what_is_no_file_is_set_aside_too(tmp_path, kind):
    swap(tmp_path / "a.txt", kind)
    write_bytes(tmp_path / "a.txt", b"ours")
    assert (tmp_path / "a.txt").read_bytes() == b"ours"
    kept = tmp_path / "a.txt.kept"
    assert kept.is_dir() if kind == "folder" else kept.is_fifo()


def test_an_edited_file_stays_the_users(tmp_path):
    (tmp_path / "page.md").write_text("the user's, with a gap")
    edit_bytes(tmp_path / "page.md", b"the user's, filled")
    assert (tmp_path / "page.md").read_bytes() == b"the user's, filled"
    assert not ownership.is_ours(tmp_path / "page.md")


def test_a_new_folder_is_claimed_and_one_with_files_refused(claimed, tmp_path):
    ownership.claim_new(tmp_path / "new")
    ownership.claim_new(claimed)
    assert ownership.is_claimed(tmp_path / "new")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.png").touch()
    with pytest.raises(InputError, match=r"holds other files\n  found: a\.png"):
        ownership.claim_new(tmp_path / "mine")
    assert not ownership.is_claimed(tmp_path / "mine")


def test_what_a_method_writes_without_a_list_is_adopted(claimed):
    with pytest.raises(RuntimeError), ownership.adopting(claimed):
        (claimed / "model.bin").write_bytes(b"a method's")
        raise RuntimeError
    assert ownership.is_ours(claimed / "model.bin")
    assert ownership.left_by_others(claimed) == [claimed / "below" / "mine.txt"]
