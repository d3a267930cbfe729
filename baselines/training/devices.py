"""Where to calculate: on the CPU, or on an NVIDIA GPU where there is one."""

import importlib.util
import logging
import os

from hydroviews.errors import InputError

logger = logging.getLogger(__name__)
DEVICES = ("auto", "cpu", "cuda")
NO_DEVICE = "torch finds no CUDA device"


def chosen_device(device: str, *packages: str) -> str:
    """ "cpu" or "cuda" for "auto", "cpu" or "cuda"; $HYDROVIEWS_DEVICE, where it is set, comes before that.

    Args:
        device: the one asked for.
        packages: what a GPU needs beside torch.

    Raises:
        InputError: an unknown device, or "cuda" without a GPU or one of the packages.
    """
    device = os.environ.get("HYDROVIEWS_DEVICE") or device
    if device not in DEVICES:
        raise InputError(f"device {device}: unknown", expected=", ".join(DEVICES), fix="correct HYDROVIEWS_DEVICE")
    if device == "cpu":
        return "cpu"
    lacking = missing_for_cuda(*packages)
    if lacking and device == "cuda":
        raise InputError("device cuda: not available", found=lacking, fix="install hydroviews[cuda], or use cpu")
    if lacking and lacking != NO_DEVICE:
        logger.warning("on the CPU, though there is a GPU: %s (install hydroviews[cuda])", lacking)
    return "cpu" if lacking else "cuda"


def missing_for_cuda(*packages: str) -> str | None:
    """Why the GPU cannot be used, or None if it can."""
    import torch

    if not torch.cuda.is_available():
        return NO_DEVICE
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    return f"{' and '.join(missing)} not installed" if missing else None
