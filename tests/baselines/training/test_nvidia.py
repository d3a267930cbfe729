"""What a machine has of NVIDIA's software, on machines made up."""

import pytest
import torch
from toolkits import program, toolkit

from baselines.training import nvidia
from baselines.training.nvidia import driver_version, toolkit_home, toolkit_version, why_no_compiler, why_no_device

LOADED = "NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  {}  Release Build\nGCC version:  gcc 12.3.0\n"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Without driver and toolkit, and with torch built for CUDA 13.0; the folder on its PATH."""
    monkeypatch.setattr(nvidia, "LOADED_DRIVER", tmp_path / "version")
    monkeypatch.setattr(nvidia, "USUAL_TOOLKIT", tmp_path / "usual")
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setenv("PATH", f"{tmp_path / 'local' / 'bin'}:/usr/bin:/bin")
    for name in ("CUDA_HOME", "CUDA_PATH", "CUDA_VISIBLE_DEVICES"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def test_the_driver_is_found_where_it_is_loaded_or_by_its_program(machine):
    program(machine / "local" / "bin" / "nvidia-smi", "echo 581.15")
    assert driver_version() == "581.15"
    (machine / "version").write_text(LOADED.format("580.65.06"))
    assert driver_version() == "580.65.06"


def test_it_is_said_why_torch_finds_no_device(machine, monkeypatch):
    (machine / "version").write_text(LOADED.format("550.54.14"))
    assert why_no_device() == "driver 550.54.14, and torch's CUDA 13.0 needs 580 or newer"
    (machine / "version").write_text(LOADED.format("580.65.06"))
    assert why_no_device() == "driver 580.65.06 is loaded, but torch finds no device"
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3")
    assert why_no_device().endswith("no device with CUDA_VISIBLE_DEVICES=3")
    monkeypatch.setattr(torch.version, "cuda", None)
    assert "built without CUDA" in why_no_device()


@pytest.mark.parametrize(
    ("version", "why"),
    [
        ("13.2", None),
        ("12.9", "CUDA toolkit 12.9 in {}, and torch is built for 13.0"),
        ("14.0", "CUDA toolkit 14.0 in {}, and torch is built for 13.0"),
    ],
)
def test_a_toolkit_of_torchs_version_compiles_and_others_are_named(machine, version, why):
    assert why_no_compiler() == "no CUDA toolkit with nvcc and headers"
    home = toolkit(machine / "usual", version)
    assert toolkit_home() == home
    assert toolkit_version(home) == version
    assert why_no_compiler() == (why and why.format(home))


def test_the_toolkit_of_a_link_or_a_script_on_the_path_is_found(machine):
    usual = toolkit(machine / "usual")
    nvcc = program(machine / "local" / "bin" / "nvcc", f"exec {usual}/bin/nvcc")
    assert toolkit_home() == usual  # and not local, which has no headers
    other = toolkit(machine / "opt" / "cuda-13.1", "13.1")
    nvcc.unlink()
    nvcc.symlink_to(other / "bin" / "nvcc")
    assert toolkit_home() == other
    headers = machine / "local" / "targets" / "x86_64-linux" / "include"
    headers.mkdir(parents=True)
    (headers / "cuda_runtime.h").touch()
    assert toolkit_home() == machine / "local"  # as conda has it


@pytest.mark.parametrize("name", ["CUDA_HOME", "CUDA_PATH"])
def test_a_toolkit_that_is_named_is_the_one(machine, monkeypatch, name):
    toolkit(machine / "usual")
    monkeypatch.setenv(name, str(machine / "none"))
    assert toolkit_home() is None
    assert why_no_compiler() == f"{name}={machine / 'none'} has no nvcc with headers"
    toolkit(machine / "none")
    assert toolkit_home() == machine / "none"
