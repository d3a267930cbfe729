"""Where to calculate: on the CPU, or on an NVIDIA GPU where there is one that can be used."""

import importlib.util
import logging
import os
from functools import cache

from hydroviews.errors import MachineError

logger = logging.getLogger(__name__)
DEVICES = ("auto", "cpu", "cuda")
VARIABLE = "HYDROVIEWS_DEVICE"
NO_DEVICE = "torch finds no CUDA device"
COMPILED = {"gsplat": "gsplat.csrc"}  # packages that compile at first use, where they came without this module
SLOW = {  # what is said of profiles on the CPU
    "standard": "the profile standard: a training takes 10 to 20 minutes on two cores",
    "paper": "the profile paper is made for a GPU: on the CPU, a training of it takes many hours or days",
}
FIX = "docs/install.md lists the driver, CUDA toolkit and packages that a GPU needs; or use cpu"


def chosen_device(device: str, *packages: str) -> str:
    """ "cpu" or "cuda" for "auto", "cpu" or "cuda"; $HYDROVIEWS_DEVICE, where it is set, comes before that.

    Where "auto" finds a GPU that cannot be used, it is the CPU, and a warning says why, once.

    Args:
        device: the one asked for.
        packages: what a GPU needs beside torch.

    Raises:
        MachineError: an unknown device, or "cuda" where no GPU can be used.
    """
    device = os.environ.get(VARIABLE) or device
    if device not in DEVICES:
        raise _unknown(device)
    if device == "cpu":
        return "cpu"
    lacking = missing_for_cuda(*packages)
    if lacking and device == "cuda":
        raise MachineError("device cuda: not available", found=lacking, fix=FIX)
    if lacking and lacking != NO_DEVICE:
        _warn_once(f"on the CPU, though there is a GPU: {lacking} ({FIX})")
    return "cpu" if lacking else "cuda"


def missing_for_cuda(*packages: str) -> str | None:
    """Why the GPU cannot be used, or None if it can."""
    import torch

    from baselines.training.nvidia import why_no_compiler, why_no_device

    if not torch.cuda.is_available():
        return why_no_device() or NO_DEVICE
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        return f"{' and '.join(missing)} not installed"
    compiles = any(importlib.util.find_spec(COMPILED[name]) is None for name in packages if name in COMPILED)
    return why_no_compiler() if compiles else None


def warn_of_slow_profile(profile: str) -> None:
    """Say beforehand how long a training takes that is more than a short one, where no GPU is used."""
    if profile in SLOW and (os.environ.get(VARIABLE) == "cpu" or missing_for_cuda()):
        _warn_once(SLOW[profile])


@cache
def _warn_once(message: str) -> None:
    logger.warning(message)


def _unknown(device: str) -> MachineError:
    name, _, number = device.partition(":")
    fix = f"correct {VARIABLE}"
    if name == "cuda" and number:  # one card is used, the first that a process sees
        fix = f"{VARIABLE}=cuda, and choose the card with CUDA_VISIBLE_DEVICES={number}"
    return MachineError(f"device {device}: unknown", expected=", ".join(DEVICES), fix=fix)
