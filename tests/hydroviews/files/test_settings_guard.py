import re

import pytest

from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_bytes, write_json
from hydroviews.files.settings_guard import claim_folder

WORDS = {"taken": "holds something else", "foreign": "holds foreign files", "fix": "choose another"}


def visible(folder):
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))


def test_the_same_settings_take_the_folder_again(tmp_path):
    path = tmp_path / "a" / "request.json"
    for note in ("first", "second"):
        claim_folder(path, {"seed": 0, "note": note}, **WORDS, ignored=("note",))
    assert read_json(path) == {"seed": 0, "note": "first"}


def test_other_settings_are_refused_with_what_differs(tmp_path):
    path = tmp_path / "a" / "request.json"
    claim_folder(path, {"seed": 0, "config": {"size": 4, "steps": 10}, "images": ["a", "b"]}, **WORDS)
    found, expected = (f"config {{'size': {n}}}; images 2 entries, only here {own}" for n, own in ((4, "b"), (5, "c")))
    said = re.escape(f"found: {found}\n  expected: {expected}\n")
    with pytest.raises(InputError, match=rf"holds something else\n  {said}"):
        claim_folder(path, {"seed": 0, "config": {"size": 5, "steps": 10}, "images": ["a", "c"]}, **WORDS)


def test_overwriting_empties_the_folder_after_it_is_forgotten(tmp_path):
    path, result, seen = tmp_path / "a" / "request.json", tmp_path / "a" / "result", []
    claim_folder(path, {"seed": 0}, **WORDS)
    write_bytes(result, b"old")
    claim_folder(path, {"seed": 1}, **WORDS, overwrite=True, forget=lambda: seen.append(result.exists()))
    assert seen == [True]
    assert visible(tmp_path / "a") == ["request.json"]
    assert read_json(path) == {"seed": 1}


def test_a_folder_without_a_list_is_never_emptied(tmp_path):
    """It is of an earlier version: nothing tells whose its files are."""
    write_json(tmp_path / "request.json", {"seed": 0})
    (tmp_path / "notes.txt").write_text("years of work")
    with pytest.raises(InputError, match="nothing tells which of its files are yours"):
        claim_folder(tmp_path / "request.json", {"seed": 1}, **WORDS, overwrite=True)
    assert visible(tmp_path) == ["notes.txt", "request.json"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_files_of_unknown_origin_are_never_removed(tmp_path, overwrite):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="holds foreign files"):
        claim_folder(tmp_path / "request.json", {"seed": 0}, **WORDS, overwrite=overwrite)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
    claim_folder(tmp_path / "request.json", {"seed": 0}, **{**WORDS, "foreign": None})


def test_a_claim_clears_leftovers(tmp_path):
    leftover = tmp_path / "a" / ".partial-host-0123-request.json"
    leftover.parent.mkdir()
    leftover.write_text("{")
    claim_folder(tmp_path / "a" / "request.json", {"seed": 0}, **WORDS)
    assert visible(leftover.parent) == ["request.json"]
    assert not leftover.exists()
