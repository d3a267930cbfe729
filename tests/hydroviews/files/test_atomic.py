import errno
import os

import pytest

from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, replacing, write_json
from hydroviews.files.ownership import FILES


def visible(folder):
    return [path.name for path in folder.iterdir() if path.name != FILES]


def test_a_failed_write_leaves_the_old_file_and_no_trace(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"old": 1})
    with pytest.raises(RuntimeError), replacing(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert read_json(path) == {"old": 1}
    assert visible(tmp_path) == ["a.json"]


def os_error(name):
    return OSError(getattr(errno, name), os.strerror(getattr(errno, name)))


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (os_error("ENOSPC"), "no space left on the disk"),
        (os_error("EDQUOT"), "no space left"),
        (RuntimeError('cannot write "a.exr". No space left on device.'), "no space left on the disk"),
        (RuntimeError("[database_sqlite.cc:603] SQLite error: disk I/O error"), "no space left on the disk"),
        (RuntimeError("[database_sqlite.cc:603] SQLite error: database or disk is full"), "no space left on the disk"),
        *((os_error(name), "cannot be written") for name in ("EACCES", "EPERM", "EROFS")),
    ],
    ids=repr,
)
def test_full_disks_and_disks_that_may_not_be_written_are_told_plainly(tmp_path, error, told):
    with pytest.raises(InputError, match=told), replacing(tmp_path / "a"):
        raise error


def test_missing_json_and_a_byte_order_mark(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_json(tmp_path / "a.json")
    (tmp_path / "a.json").write_text('{"rain": "none"}', "utf-8-sig")
    assert read_json(tmp_path / "a.json") == {"rain": "none"}


def test_one_path_is_written_twice_at_once(tmp_path):
    """As by two containers that share a folder: process numbers may be the same in both."""
    with replacing(tmp_path / "a") as first, replacing(tmp_path / "a") as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert (tmp_path / "a").read_text() == "first"
    assert visible(tmp_path) == ["a"]


@pytest.mark.parametrize(
    "text", ['{"cut": ', "[" * 100_000, "9" * 5000, "9" * 400, '{"a": "\\ud800"}', "\xff", "NaN,"], ids=lambda t: t[:9]
)
def test_odd_json_is_told(tmp_path, text):
    (tmp_path / "odd.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"odd\.json: not valid JSON"):
        read_json(tmp_path / "odd.json")
