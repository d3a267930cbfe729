import errno
import os
import subprocess
import sys
import time

import pytest

from hydroviews.errors import InputError
from hydroviews.files.atomic import locked, read_json, replacing, write_json


def test_a_failed_write_leaves_the_old_file_and_no_trace(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"old": 1})
    with pytest.raises(RuntimeError), replacing(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert read_json(path) == {"old": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "full"), RuntimeError('cannot write "a.exr". No space left on device.')]
)
def test_full_disk_is_told_plainly(tmp_path, error):
    with pytest.raises(InputError, match="no space left on the disk"), replacing(tmp_path / "a"):
        raise error


def test_broken_json(tmp_path):
    (tmp_path / "a.json").write_text('{"cut": ')
    with pytest.raises(InputError, match="not valid JSON"):
        read_json(tmp_path / "a.json")
    with pytest.raises(InputError, match="no such file"):
        read_json(tmp_path / "b.json")


OTHER = """
import sys
from pathlib import Path
from hydroviews.files.atomic import locked
with locked(Path(sys.argv[1]), "busy"):
    Path(sys.argv[1]).write_text("changed")
"""


def test_who_wants_what_is_locked_waits(tmp_path):
    path = tmp_path / "a"
    with locked(path):
        other = subprocess.Popen([sys.executable, "-c", OTHER, str(path)], stderr=subprocess.PIPE, text=True)
        assert other.stderr is not None
        assert other.stderr.readline() == f"{path}: busy\n"
        time.sleep(0.1)
        assert other.poll() is None
        assert not path.exists()
    assert other.wait(30) == 0
    assert path.read_text() == "changed"
    with locked(path):  # nobody has it any more
        pass


def test_a_file_in_the_way_of_a_folder_is_told(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(InputError, match="not a folder"), locked(tmp_path / "a" / "b"):
        pass


@pytest.mark.parametrize("refusal", [errno.EROFS, errno.EACCES])
def test_where_nothing_can_be_written_nobody_waits(tmp_path, monkeypatch, refusal):
    def refuse(*arguments, **options):
        raise OSError(refusal, "no")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    done = []
    with locked(tmp_path / "a"):
        done.append(True)
    assert done
    with pytest.raises(OSError, match="inside"), locked(tmp_path / "a"):  # what the block raises is its own
        raise OSError(refusal, "inside")


@pytest.mark.parametrize("number", [errno.EDQUOT, errno.EACCES, errno.EROFS])
def test_disks_that_may_not_be_written_are_told_plainly(tmp_path, number):
    with pytest.raises(InputError, match=r"no space left|cannot be written"), replacing(tmp_path / "a.txt"):
        raise OSError(number, os.strerror(number))
