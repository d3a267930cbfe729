"""What a machine has of NVIDIA's software: the driver, and the CUDA toolkit with which code is compiled for a GPU."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import torch

LOADED_DRIVER = Path("/proc/driver/nvidia/version")
LEAST_DRIVERS = {12: 525, 13: 580}  # by CUDA's major version (NVIDIA, CUDA Compatibility, table 1)
USUAL_TOOLKIT = Path("/usr/local/cuda")
TOOLKIT_VARIABLES = ("CUDA_HOME", "CUDA_PATH")  # torch reads them in this order
SECONDS = 10.0  # that a program may take to say its version


def driver_version() -> str | None:
    """Of the NVIDIA driver, such as 580.65.06; None where there is none, and so no GPU."""
    if LOADED_DRIVER.is_file():
        told = LOADED_DRIVER.read_text()
    else:  # Windows' subsystem for Linux has only this
        told = _told("nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader")
    found = re.search(r"\b\d{3,}(\.\d+)+\b", told)
    return found[0] if found else None


def why_no_device() -> str | None:
    """Why torch cannot use the GPU, where it finds none although there is a driver; None where there is no driver."""
    driver, cuda = driver_version(), torch.version.cuda
    if driver is None:
        return None
    if cuda is None:
        return f"torch {torch.__version__} is built without CUDA"
    least = LEAST_DRIVERS.get(_major(cuda))
    if least and _major(driver) < least:
        return f"driver {driver}, and torch's CUDA {cuda} needs {least} or newer"
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    chosen = "" if visible is None else f" with CUDA_VISIBLE_DEVICES={visible}"
    return f"driver {driver} is loaded, but torch finds no device{chosen}"


def toolkit_home() -> Path | None:
    """The folder of the CUDA toolkit, with nvcc and its headers; None where there is none.

    It is the one that $CUDA_HOME or $CUDA_PATH names. Otherwise it is the one of the nvcc on PATH, which may be a link
    or a script outside of the toolkit, or the usual one.
    """
    if named := _named_toolkit():
        homes = [Path(named[1])]
    else:
        nvcc = shutil.which("nvcc")
        programs = [Path(nvcc), Path(nvcc).resolve()] if nvcc else []
        homes = [*(program.parent.parent for program in programs), USUAL_TOOLKIT]
    return next((home for home in homes if _is_toolkit(home)), None)


def why_no_compiler() -> str | None:
    """Why CUDA code cannot be compiled for this torch; None if it can."""
    home, named, cuda = toolkit_home(), _named_toolkit(), torch.version.cuda
    if home is None:
        return "{}={} has no nvcc with headers".format(*named) if named else "no CUDA toolkit with nvcc and headers"
    version = toolkit_version(home)
    if cuda and _major(version) != _major(cuda):
        return f"CUDA toolkit {version} in {home}, and torch is built for {cuda}"
    return None


def toolkit_version(home: Path) -> str:
    """Of a toolkit, such as 13.0, as its nvcc says; 0 if it says none."""
    found = re.search(r"release (\d+(\.\d+)*)", _told(str(home / "bin" / "nvcc"), "--version"))
    return found[1] if found else "0"


def _named_toolkit() -> tuple[str, str] | None:
    """The variable that names the toolkit, and its value."""
    return next(((name, os.environ[name]) for name in TOOLKIT_VARIABLES if os.environ.get(name)), None)


def _is_toolkit(home: Path) -> bool:
    header = Path("include", "cuda_runtime.h")
    headers = [home / header, *home.glob(f"targets/*/{header}")]  # conda has them there
    return (home / "bin" / "nvcc").is_file() and any(path.is_file() for path in headers)


def _major(version: str) -> int:
    return int(version.partition(".")[0])


def _told(*command: str) -> str:
    """What a program prints; nothing where there is none or it fails."""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""
