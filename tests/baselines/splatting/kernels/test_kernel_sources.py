"""Machine code is of the sources as they are: an edited file is compiled anew, and so is all that calls it."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

from numba.core.dispatcher import Dispatcher

import baselines
import deraings
from baselines.splatting.backends import warm_up
from baselines.splatting.backends.warm_up import compile_apart
from baselines.splatting.kernels import jit, simd

SHARED = "from kernels.jit import inlined\n\n@inlined\ndef shift(x):\n    return x + {}\n"
CALLER = """from kernels.jit import serial_kernel, inlined
from kernels.shared import shift

@inlined
def scale(x):
    return x * {}

@serial_kernel
def {}(x):
    return scale(shift(x))
"""


def results(folder: Path) -> list[float]:
    """What two kernels make of 1, in a process of their own: one beside `jit.py`, one elsewhere."""
    code = "from kernels.inside import inside\nfrom outside import outside\nprint(inside(1.0), outside(1.0))"
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # Python itself takes a file of the same size and date for the same
    done = subprocess.check_output([sys.executable, "-c", code], cwd=folder, env=environment)
    return [float(word) for word in done.split()]


def write_undated(path: Path, content: str) -> None:
    """Of the same size and date as before, as checkouts and packages may be."""
    path.write_text(content)
    os.utime(path, (1, 1))


def test_an_edited_file_changes_what_kernels_calculate(tmp_path):
    folder = tmp_path / "kernels"
    folder.mkdir()
    shutil.copy(jit.__file__, folder / "jit.py")
    (folder / "__init__.py").touch()
    write_undated(folder / "shared.py", SHARED.format(1))
    write_undated(folder / "inside.py", CALLER.format(1, "inside"))
    write_undated(tmp_path / "outside.py", CALLER.format(2, "outside"))
    for _ in range(2):
        assert results(tmp_path) == [2, 4]
    write_undated(folder / "shared.py", SHARED.format(2))
    assert results(tmp_path) == [3, 6]
    write_undated(tmp_path / "outside.py", CALLER.format(3, "outside"))
    assert results(tmp_path) == [3, 9]


def test_edited_sources_are_compiled_apart_once(tmp_path, monkeypatch, caplog):
    source = tmp_path / "kernel.py"
    monkeypatch.setattr(warm_up, "FOLDER", str(tmp_path))
    code = f"from pathlib import Path; Path({str(tmp_path)!r}, 'runs').open('a').write('.')"
    for content in ("one", "one", "two"):
        source.write_text(content)
        compile_apart("all", code, [source])
    assert (tmp_path / "runs").read_text() == ".."
    assert len([message for message in caplog.messages if "compiling the kernels" in message]) == 2


def test_sources_that_were_copied_with_what_was_compiled_are_compiled_apart(tmp_path, monkeypatch):
    monkeypatch.setattr(warm_up, "FOLDER", str(tmp_path))
    for name in ("checkout", "copy"):
        (folder := tmp_path / name).mkdir()
        (folder / "kernel.py").touch()
        compile_apart("all", f"open({str(folder / 'ran')!r}, 'w')", [folder / "kernel.py"])
    assert (tmp_path / "copy" / "ran").exists()


def test_machine_code_is_not_shared_by_instructions_or_processors():
    """Another processor is one that Numba is told to compile for."""
    command = [sys.executable, "-c", "from baselines.splatting.kernels.jit import FOLDER; print(FOLDER)"]
    settings = [*({simd.VARIABLE: name} for name in simd.available()), {"NUMBA_CPU_NAME": "nocona"}]
    folders = {subprocess.check_output(command, env={**os.environ, **one}) for one in settings}
    assert len(folders) == len(settings)


def compiled() -> list[Dispatcher]:
    """All compiled functions of the packages."""
    found: dict[int, Dispatcher] = {}
    for package in (baselines, deraings):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not info.name.endswith(("__main__", "backends.cuda")):
                members = vars(importlib.import_module(info.name)).values()
                found |= {id(member): member for member in members if isinstance(member, Dispatcher)}
    return list(found.values())


def home(kernel: Dispatcher) -> Path:
    return Path(kernel.py_func.__code__.co_filename)


def test_kernels_call_what_the_cache_knows_of():
    strangers = []
    for kernel in compiled():
        function = kernel.py_func
        called = [function.__globals__.get(name) for name in function.__code__.co_names]
        files = {home(other) for other in called if isinstance(other, Dispatcher)}
        strangers += [(kernel, file) for file in files if file != home(kernel) and jit.HERE not in file.parents]
    assert not strangers


def test_the_splatting_core_has_its_kernels_in_one_folder():
    """Which `warm_up` compiles apart whenever a file in it changes."""
    core = [home(kernel) for kernel in compiled() if jit.HERE.parent in home(kernel).parents]
    assert len(core) > 30
    assert set(core) <= set(jit.SOURCES)
