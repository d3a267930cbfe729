import errno
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from unittest.mock import Mock

import pytest
from processes import PATIENCE

from hydroviews.errors import InputError
from hydroviews.files.locks import locked, locked_if_free

PROCESS = """
import sys, time
from pathlib import Path
from hydroviews.files.locks import locked
with locked(Path(sys.argv[1]), "busy"):
    Path(sys.argv[1]).write_text("held")
    print("held", flush=True)
    time.sleep(float(sys.argv[2]))
"""


def process_that_locks(path, seconds):
    """A process that wants the lock of a path and then holds it for some seconds."""
    command = [sys.executable, "-c", PROCESS, str(path), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def holder(tmp_path):
    """A process that holds the lock of `a`."""
    process = process_that_locks(tmp_path / "a", 600)
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate(timeout=PATIENCE)


def test_who_wants_what_is_locked_waits(tmp_path):
    path = tmp_path / "a"
    with locked(path):
        other = process_that_locks(path, 0)
        assert other.stderr.readline() == f"{path}: busy for {socket.gethostname()}, process {os.getpid()}\n"
        time.sleep(0.1)
        assert other.poll() is None
        assert not path.exists()
    other.communicate(timeout=PATIENCE)
    assert (other.returncode, path.read_text()) == (0, "held")
    with locked(path):  # nobody has it any more
        pass


def test_a_file_in_the_way_of_a_folder_is_told(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(InputError, match="not a folder"), locked(tmp_path / "a" / "b"):
        pass


@pytest.mark.parametrize("refusal", ["EROFS", "EACCES", "EPERM", "ENOLCK", "ENOSYS", "EOPNOTSUPP"])
def test_where_no_lock_can_be_had_nobody_waits_and_nothing_counts_as_free(tmp_path, monkeypatch, refusal):
    number = getattr(errno, refusal)
    monkeypatch.setattr("os.open", Mock(side_effect=OSError(number, "no")))
    with pytest.raises(OSError, match="inside"), locked(tmp_path / "a"):  # what the block raises is its own
        raise OSError(number, "inside")
    with locked_if_free(tmp_path / "a") as free:
        assert not free


def test_threads_wait_for_each_other(tmp_path):
    order = []

    def work():
        with locked(tmp_path / "a"):
            order.append("thread")

    with locked(tmp_path / "a"):
        thread = threading.Thread(target=work)
        thread.start()
        time.sleep(0.2)
        order.append("first")
    thread.join(30)
    assert order == ["first", "thread"]


def test_a_killed_process_holds_no_lock(tmp_path, holder):
    with locked_if_free(tmp_path / "a") as free:
        assert not free
    holder.kill()
    holder.wait(PATIENCE)
    with locked_if_free(tmp_path / "a") as free:
        assert free


def test_ctrl_c_ends_the_wait(tmp_path, holder, caplog):
    threading.Timer(0.3, signal.raise_signal, (signal.SIGINT,)).start()
    with pytest.raises(KeyboardInterrupt), locked(tmp_path / "a", "busy"):
        pytest.fail("it was locked")
    assert f"busy for {socket.gethostname()}, process {holder.pid}" in caplog.text
