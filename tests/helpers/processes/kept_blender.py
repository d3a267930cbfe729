"""One Blender process for many requests: to start one takes longer than most of what tests ask of it."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

MISSING = "bpy is not installed: pip install 'hydroviews[blender]'"
SERVER = """
import importlib, json, os, sys, traceback
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # what Blender itself prints is no answer
import bpy
for line in sys.stdin:
    module, request = json.loads(line)
    answer = ""
    try:
        importlib.import_module(f"hydroviews.blender.{module}").main(request, lambda done, total: None)
    except Exception:
        answer = traceback.format_exc()
    print(json.dumps(answer), file=answers, flush=True)
"""


def needs_blender(test: Callable) -> Callable:
    """Marks a test that starts Blender processes."""
    return pytest.mark.blender(pytest.mark.skipif(find_spec("bpy") is None, reason=MISSING)(test))


def bakes(test: Callable) -> Callable:
    """Marks a test whose lenses are baked by the kept process."""
    return pytest.mark.usefixtures("kept")(needs_blender(test))


class KeptBlender:
    """Stands in for `hydroviews.blender.process.run_blender`; starts its process when it is first asked."""

    def __init__(self) -> None:
        self._process: subprocess.Popen | None = None

    def __call__(self, module: str, request: dict[str, Any], log: Path, label: str) -> None:
        if self._process is None:
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            self._process = subprocess.Popen([sys.executable, "-c", SERVER], text=True, **pipes)
        self._process.stdin.write(json.dumps([module, request]) + "\n")
        self._process.stdin.flush()
        failure = json.loads(self._process.stdout.readline())
        assert not failure, failure

    def end(self) -> None:
        if self._process is not None:
            self._process.stdin.close()
            self._process.stdout.close()
            self._process.wait()


@pytest.fixture(scope="session")
def kept_blender() -> Iterator[KeptBlender]:
    """The process; what a test asks of it sees nothing of what was asked before."""
    blender = KeptBlender()
    yield blender
    blender.end()
