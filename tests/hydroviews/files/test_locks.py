import errno
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from processes import PATIENCE

from hydroviews.errors import InputError
from hydroviews.files.locks import locked, locked_if_free

OTHER = """
import sys
from pathlib import Path
from hydroviews.files.locks import locked
with locked(Path(sys.argv[1]), "busy"):
    Path(sys.argv[1]).write_text("changed")
"""


def test_who_wants_what_is_locked_waits(tmp_path):
    path = tmp_path / "a"
    with locked(path):
        other = subprocess.Popen([sys.executable, "-c", OTHER, str(path)], stderr=subprocess.PIPE, text=True)
        assert other.stderr is not None
        assert other.stderr.readline() == f"{path}: busy for {socket.gethostname()}, process {os.getpid()}\n"
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


@pytest.mark.parametrize("refusal", ["EROFS", "EACCES", "EPERM", "ENOLCK", "ENOSYS", "EOPNOTSUPP"])
def test_where_no_lock_can_be_had_nobody_waits_and_nothing_counts_as_free(tmp_path, monkeypatch, refusal):
    number = getattr(errno, refusal)

    def refuse(*arguments, **options):
        raise OSError(number, "no")

    monkeypatch.setattr("os.open", refuse)
    done = []
    with locked(tmp_path / "a"):
        done.append(True)
    assert done
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


HOLDER = """
import sys, time
from pathlib import Path
from hydroviews.files.locks import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds the lock of `a`."""
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path / "a")], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait(PATIENCE)


def test_a_killed_process_holds_no_lock(tmp_path, holder):
    with locked_if_free(tmp_path / "a") as free:
        assert not free
    holder.kill()
    holder.wait(PATIENCE)
    with locked_if_free(tmp_path / "a") as free:
        assert free


def test_ctrl_c_ends_the_wait(tmp_path, holder, caplog):
    timer = threading.Timer(0.3, signal.raise_signal, (signal.SIGINT,))
    timer.start()
    with pytest.raises(KeyboardInterrupt), caplog.at_level(logging.WARNING), locked(tmp_path / "a", "busy"):
        pytest.fail("it was locked")
    assert f"busy for {socket.gethostname()}, process {holder.pid}" in caplog.text
