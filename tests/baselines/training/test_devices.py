"""Which device is chosen, and what is said where it is not the one that was hoped for; torch's number of threads."""

import os
import subprocess
import sys

import pytest
import torch

from baselines.training import devices, nvidia
from baselines.training.devices import chosen_device, warn_of_slow_profile
from hydroviews.errors import InputError


@pytest.fixture(autouse=True)
def nothing_said_yet(monkeypatch):
    monkeypatch.delenv("HYDROVIEWS_DEVICE", raising=False)
    devices._warn_once.cache_clear()


@pytest.fixture
def no_device(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(nvidia, "driver_version", lambda: None)


def test_the_environment_has_the_last_word_and_unknown_devices_are_refused(no_device, monkeypatch, caplog):
    assert chosen_device("auto", "gsplat") == chosen_device("cpu") == "cpu"
    assert not caplog.records  # a machine without a GPU is no reason to say anything
    with pytest.raises(InputError, match="device tpu"):
        chosen_device("tpu")
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cpu")
    assert chosen_device("cuda") == "cpu"
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda")
    with pytest.raises(InputError, match="no CUDA device"):
        chosen_device("cpu")


def test_a_gpu_is_of_no_use_without_the_package_that_is_needed_there(monkeypatch, caplog):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert chosen_device("auto", "numpy") == "cuda"
    assert chosen_device("auto", "no_such_package") == "cpu"
    assert "no_such_package not installed" in caplog.text
    with pytest.raises(InputError, match="no_such_package not installed"):
        chosen_device("cuda", "no_such_package")


def test_a_gpu_that_torch_cannot_use_is_said_once(no_device, monkeypatch, caplog):
    monkeypatch.setattr(nvidia, "driver_version", lambda: "550.54.14")
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    assert [chosen_device("auto"), chosen_device("auto", "gsplat")] == ["cpu", "cpu"]
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert "on the CPU, though there is a GPU: driver 550.54.14, and torch's CUDA 13.0 needs 580" in record.message
    with pytest.raises(InputError, match=r"not available[\s\S]*needs 580"):
        chosen_device("cuda")


def test_a_gpu_that_nothing_can_be_compiled_for_is_said(pretended_gpu, monkeypatch, caplog):
    assert chosen_device("auto", "gsplat") == "cuda"  # it was installed with its kernels
    monkeypatch.delitem(sys.modules, "gsplat.csrc")
    monkeypatch.setenv("CUDA_HOME", "/no/toolkit")
    assert chosen_device("auto") == "cuda"
    assert chosen_device("auto", "gsplat") == "cpu"
    assert "on the CPU, though there is a GPU: CUDA_HOME=/no/toolkit has no nvcc with headers" in caplog.text
    with pytest.raises(InputError, match="CUDA_HOME=/no/toolkit"):
        chosen_device("cuda", "gsplat")


def test_cards_are_chosen_by_cudas_own_variable(monkeypatch):
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda:1")
    with pytest.raises(InputError, match=r"cuda:1: unknown[\s\S]*=cuda, and[\s\S]*CUDA_VISIBLE_DEVICES=1"):
        chosen_device("auto")
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda:")
    with pytest.raises(InputError, match="correct HYDROVIEWS_DEVICE"):
        chosen_device("auto")


def test_long_trainings_on_the_cpu_are_announced_once(no_device, caplog):
    for profile in ("demo", "standard", "standard", "paper", "paper"):
        warn_of_slow_profile(profile)
    assert [record.levelname for record in caplog.records] == ["WARNING"] * 2
    assert "10 to 20 minutes on two cores" in caplog.messages[0]
    assert "paper is made for a GPU" in caplog.messages[1]


CODE = """
import torch
from baselines.training.torch_state import one_thread

with one_thread():
    import numba

    @numba.njit(parallel=True)
    def count(n):
        total = 0
        for i in numba.prange(n):
            total += i
        return total

    assert count(10) == 45
    print(torch.get_num_threads())
"""


def test_threads_that_numba_starts_leave_torch_with_one():
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    found = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["1"]
