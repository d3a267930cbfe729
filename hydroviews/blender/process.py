"""Start a Blender process, show its progress, and turn its failures into errors a user can act on."""

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from tqdm import tqdm

from hydroviews.cli.processes import held_signals
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import write_json

Report = Callable[[int, int], None]  # what a Blender process tells its parent: steps done, steps in all

# The system libraries that importing bpy 5.0 loads (ldd and /proc/PID/maps), as Debian and Ubuntu name them.
SYSTEM_PACKAGES = "libx11-6 libxext6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1"
LAST_LINES = 12
PATIENCE = 5.0  # seconds a process is given to end before it is killed


class NoBlender(InputError):
    """Blender's module bpy is not installed, or cannot be loaded."""


def run_blender(module: str, request: dict[str, Any], log: Path, label: str) -> None:
    """Run `hydroviews.blender.<module>.main(request, report)` in a Blender process and wait for it.

    Args:
        module: the module's name within this package.
        request: JSON values; paths as strings.
        log: where everything Blender prints goes.
        label: the progress bar's text.

    Raises:
        NoBlender: no bpy, or no system library for it.
        InputError: bad input found by the module, or the process failed.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    ownership.enter(log)  # Blender writes it, not `replacing`
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder, log.open("wb") as log_file:
        request_file = Path(folder) / "request.json"
        write_json(request_file, request)
        command = [sys.executable, "-m", "hydroviews.blender.worker", module, str(request_file)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log_file, text=True)
        try:
            failure = _follow(process, label)
            status = process.wait()
        finally:
            with held_signals():  # a second Ctrl-C would leave Blender behind
                _end(process)
    if failure is not None:
        _raise_failure(failure)
    if status != 0:
        raise _died(module, status, log)


def _follow(process: subprocess.Popen, label: str) -> dict[str, str] | None:
    """Draw the progress bar until the process closes its messages; its failure message, if it sent one."""
    failure = None
    assert process.stdout is not None
    with process.stdout, tqdm(desc=label, leave=False) as bar:
        for line in process.stdout:
            message = json.loads(line)
            if "failure" in message:
                failure = message
            else:
                bar.total = message["total"]
                bar.n = message["done"]
                bar.refresh()
    return failure


def _end(process: subprocess.Popen) -> None:
    """No process outlives the call, not even after Ctrl-C."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _raise_failure(failure: dict[str, str]) -> NoReturn:
    kind, text = failure["failure"], failure["text"]
    if kind == "no bpy":
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise NoBlender(
            "Blender's Python module bpy is not installed",
            found=f"Python {python} at {sys.executable}",
            expected="Python 3.11 (or 3.13) with bpy",
            fix="run `make setup`, or `pip install 'hydroviews[blender]'` in a Python 3.11",
        )
    if kind == "bpy import":
        raise NoBlender(
            "Blender's Python module bpy cannot be loaded",
            found=text,
            fix=f"install the system libraries it needs, on Debian or Ubuntu: apt-get install {SYSTEM_PACKAGES}",
        )
    raise InputError(text)


def _died(module: str, status: int, log: Path) -> InputError:
    ended = f"by signal {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
    lines = log.read_text(errors="replace").splitlines()[-LAST_LINES:]
    return InputError(
        f"the Blender process {module} ended {ended}",
        found="the last lines of its log:\n    " + "\n    ".join(lines),
        fix=f"run the same command again, finished files are kept; the whole log is {log}",
    )
