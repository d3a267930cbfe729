"""gsplat's own build, as far as a compiler that only complains: what it is given, and what is said of it."""

import os
import sys

import pytest
import torch
from toolkits import program, toolkit

pytest.importorskip("gsplat", reason="needs gsplat's Python: pip install gsplat, no GPU needed")
from torch.utils import cpp_extension

from baselines.splatting.backends.gsplat_kernels import LOG, require_kernels
from baselines.training import nvidia
from hydroviews.errors import InputError

COMPLAINTS = "k=0; while [ $k -lt 50 ]; do k=$((k + 1)); echo complaint $k of $0; done; exit 1"
VERSION = 'case "$*" in *version) echo "c++ (GCC) 13.2.0"; exit;; *dumpfullversion*) echo 13.2.0; exit;; esac'


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A toolkit that is found only where it usually is, and nothing of Python's environment on PATH."""
    monkeypatch.setattr(nvidia, "LOADED_DRIVER", tmp_path / "version")
    monkeypatch.setattr(nvidia, "USUAL_TOOLKIT", toolkit(tmp_path / "usual", otherwise=COMPLAINTS))
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(cpp_extension, "CUDA_HOME", None)
    monkeypatch.setenv("CUDA_HOME", "")  # so that what is set here is taken back
    monkeypatch.delenv("CUDA_PATH", raising=False)
    program(tmp_path / "local" / "bin" / "nvcc", f"exec {tmp_path}/usual/bin/nvcc")
    monkeypatch.setenv("PATH", f"{tmp_path}/local/bin")  # not even a ninja of the system's
    monkeypatch.setenv("CXX", str(program(tmp_path / "local" / "bin" / "c++", f"{VERSION}\n{COMPLAINTS}")))
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path / "built"))
    monkeypatch.setenv("TORCH_CUDA_ARCH_LIST", "9.0")
    monkeypatch.setenv("HYDROVIEWS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delitem(sys.modules, "gsplat.cuda._backend", raising=False)
    return tmp_path


def test_what_compilers_say_goes_to_a_file_and_its_end_is_shown(machine):
    with pytest.raises(InputError) as caught:
        require_kernels()
    message, log = str(caught.value), machine / "cache" / LOG
    assert "its CUDA code does not compile" in message
    assert f"complaint 50 of {machine}/usual/bin/nvcc" in log.read_text()  # with ninja, and not by the script on PATH
    assert message.count("complaint") <= 20 < log.read_text().count("complaint")
    needed = "driver 580", "CUDA toolkit 13.0", "Python's headers"
    for word in (str(log), *needed, "MAX_JOBS=2", "HYDROVIEWS_DEVICE=cpu"):
        assert word in message
    assert os.environ["CUDA_HOME"] == str(machine / "usual")


def test_without_a_toolkit_nothing_is_compiled(machine, monkeypatch):
    monkeypatch.setattr(nvidia, "USUAL_TOOLKIT", machine / "none")
    (machine / "local" / "bin" / "nvcc").unlink()
    monkeypatch.setattr(cpp_extension, "_find_cuda_home", lambda: None)  # as where there is no /usr/local/cuda
    with pytest.raises(InputError, match=r"no compiled CUDA code[\s\S]*no CUDA toolkit[\s\S]*nvcc"):
        require_kernels()


def test_kernels_that_came_with_gsplat_need_no_compiler(pretended_gpu, machine, monkeypatch):
    monkeypatch.setenv("CUDA_HOME", "/no/toolkit")
    require_kernels()
