import os
import shutil

import pytest

from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import replacing, write_bytes


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


def test_what_was_written_is_ours_and_nothing_else(claimed):
    assert ownership.is_ours(claimed / "a.png")
    assert ownership.is_ours(claimed / "below" / "b é\n.png")
    assert not ownership.is_ours(claimed / "below" / "mine.txt")
    assert ownership.left_by_others(claimed) == [claimed / "below" / "mine.txt"]


def test_removing_leaves_what_is_not_ours(claimed):
    assert ownership.remove(claimed) == [claimed / "below" / "mine.txt"]
    assert (claimed / "below" / "mine.txt").read_text() == "the user's"
    assert not (claimed / "a.png").exists()
    assert [path.name for path in (claimed / "below").iterdir()] == ["mine.txt"]


def test_removing_what_is_ours_alone_removes_the_folder(claimed):
    (claimed / "below" / "mine.txt").unlink()
    (claimed / ".DS_Store").unlink()
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
    ownership.enter_all(["work/", "work.db"], claimed)
    (claimed / "work").mkdir()
    for name in ("work/anything", "work.db"):
        (claimed / name).write_bytes(b"")
    left = [claimed / "below" / "mine.txt", claimed / "model" / "mine.ply"]
    assert ownership.left_by_others(claimed) == left
    assert ownership.remove(claimed) == left


def test_names_that_other_programs_will_write_must_be_free(claimed):
    (claimed / "work.db").write_bytes(b"the user's")
    with pytest.raises(InputError, match=r"work\.db"):
        ownership.enter_all(["work.db"], claimed)


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
