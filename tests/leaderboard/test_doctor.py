"""The doctor: each thing that a machine may lack, with what to do about it."""

import os
import shutil
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from hydroviews.blender.process import SYSTEM_PACKAGES
from leaderboard import doctor
from leaderboard.doctor import LATER, MISSING, OK, Finding

ABSENT = "raise ModuleNotFoundError(\"No module named 'bpy'\", name='bpy')"


@pytest.mark.parametrize(
    ("bpy", "state", "found", "fix"),
    [
        ("from types import SimpleNamespace\napp = SimpleNamespace(version_string='5.0.1')", OK, "bpy 5.0.1", ""),
        (ABSENT, MISSING, "`hydroviews reconstruct` works without it", "pip install 'hydroviews[blender]'"),
        ("raise ImportError('libX11.so.6: cannot open')", MISSING, "libX11.so.6", f"apt-get install {SYSTEM_PACKAGES}"),
        ("import os\nos.abort()", MISSING, "exit status -6", ""),
    ],
    ids=["works", "not installed", "no X11", "dies"],
)
def test_blender(tmp_path, monkeypatch, bpy, state, found, fix):
    """A module of the given text in bpy's place, for processes started from here."""
    (tmp_path / "bpy.py").write_text(bpy)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    told = doctor.blender()
    assert told.state == state
    assert found in told.found
    assert fix in told.fix


@pytest.mark.parametrize(("version", "state"), [((3, 11), OK), ((3, 12), LATER), ((3, 13), OK)])
def test_pythons_that_have_a_blender(version, state):
    assert doctor.python_version(version).state == state


@pytest.mark.parametrize(("free", "state"), [(1.2, MISSING), (30.0, OK)])
def test_space(monkeypatch, tmp_path, free, state):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=free * 1e9))
    found = doctor.disk(tmp_path)
    assert found.state == state
    assert f"{free:.1f} GB free in {tmp_path}" in found.found
    assert ("DATA=" in found.fix) == (state == MISSING)


@pytest.mark.parametrize(("load", "state"), [(0.1, OK), (3.5, LATER)])
def test_a_slow_machine(monkeypatch, load, state):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(os, "getloadavg", lambda: (load, load, load))
    found = doctor.speed()
    assert found.state == state
    assert ("wait until other programs are done" in found.fix) == (state == LATER)


@pytest.mark.parametrize(
    ("lacking", "state", "words"),
    [
        (None, OK, "used for training"),
        ("torch finds no CUDA device", LATER, "none; training runs on the CPU"),
        ("no CUDA toolkit", LATER, "not used: no CUDA toolkit"),
    ],
)
def test_a_gpu_without_its_toolkit(monkeypatch, lacking, state, words):
    monkeypatch.setattr("baselines.training.devices.missing_for_cuda", lambda *packages: lacking)
    found = doctor.gpu()
    assert (found.state, found.found) == (state, words)
    assert ("docs/install.md" in found.fix) == (lacking == "no CUDA toolkit")


def test_what_is_downloaded_later(tmp_path):
    assert [found.state for found in doctor.weights(tmp_path)] == [LATER, LATER]
    for name in ("lpips-v0.1-alex", "xfeat-scm"):
        (tmp_path / f"{name}.safetensors").touch()
    assert [found.state for found in doctor.weights(tmp_path)] == [OK, OK]


@pytest.mark.parametrize("state", [OK, LATER, MISSING])
def test_only_what_is_needed_fails_the_command(monkeypatch, capsys, state):
    monkeypatch.setattr(doctor, "findings", lambda: iter([Finding("disk", state, "little", "free some")]))
    with pytest.raises(SystemExit, match="1") if state == MISSING else nullcontext():
        doctor.doctor_command()
    first, second = capsys.readouterr().out.splitlines()
    assert first.split() == [state, "disk", "little"]
    assert second.strip() == "what to do: free some"
