"""gsplat's kernels, compiled at their first use: with what, and what is said where it does not work."""

import importlib
import os
import sysconfig

import torch
from torch.utils import cpp_extension

from baselines.training.nvidia import LEAST_DRIVERS, toolkit_home, why_no_compiler
from hydroviews.errors import MachineError
from hydroviews.files.atomic import write_bytes
from hydroviews.files.cache import cache_folder
from hydroviews.files.locks import locked

LOG = "gsplat-build.log"
SHOWN = 20  # of its last lines


def require_kernels() -> None:
    """Load gsplat's kernels, which compiles them at their first use: some minutes.

    One process at a time: another that begins meanwhile would delete what is there.

    Raises:
        MachineError: they do not compile or load, or nothing is there to compile them with.
    """
    with locked(cache_folder() / "gsplat", "another process compiles gsplat; waiting"):
        _prepare_compiler()
        try:
            kernels = importlib.import_module("gsplat.cuda._backend")._C
        except Exception as error:  # whatever compilers and linkers say
            raise _not_compiled(str(error)) from error
    if kernels is None:  # its Python part alone, which can be imported, and whose first step would break
        raise MachineError("gsplat: no compiled CUDA code", found=why_no_compiler(), fix=_needs())


def _prepare_compiler() -> None:
    """Let torch find ninja, which pip installs beside Python, and the toolkit, where its own guess has no headers."""
    scripts, folders = sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath).split(os.pathsep)
    if scripts not in folders:
        os.environ["PATH"] = os.pathsep.join([scripts, *folders])
    if home := toolkit_home():
        os.environ["CUDA_HOME"] = str(home)
        cpp_extension.CUDA_HOME = str(home)  # it looked when it was imported


def _not_compiled(output: str) -> MachineError:
    """The end of what compilers said; all of it goes to a file."""
    log = cache_folder() / LOG
    write_bytes(log, output.encode())
    end = "\n    ".join(output.splitlines()[-SHOWN:])
    return MachineError("gsplat: its CUDA code does not compile", found=f"{end}\n    (all of it: {log})", fix=_needs())


def _needs() -> str:
    major = int((torch.version.cuda or "0").partition(".")[0])
    driver = f"NVIDIA driver {LEAST_DRIVERS[major]} or newer, " if major in LEAST_DRIVERS else ""
    return (
        f"have {driver}the CUDA toolkit {torch.version.cuda or ''} (nvcc), g++ and Python's headers (python3-dev); "
        "with MAX_JOBS=2 where memory runs out; or do without, HYDROVIEWS_DEVICE=cpu"
    )
