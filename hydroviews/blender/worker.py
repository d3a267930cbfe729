"""The Blender process: `python -m hydroviews.blender.worker MODULE REQUEST.json`, started by `process.run_blender`.

Messages to the parent are JSON objects, one a line, on what was standard output; all else that is printed,
by Blender's own code too, goes to standard error, which is the log.
"""

import importlib
import json
import os
import sys
from pathlib import Path
from typing import TextIO

from hydroviews.cli.logs import show_logs
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json


def main() -> int:
    """Run one module on one request; 0 when it ended well, 1 after a failure that the parent was told of."""
    module, request = sys.argv[1], read_json(Path(sys.argv[2]))
    messages = _take_standard_output()
    try:
        import bpy  # noqa: F401  (first: whether it loads is what the parent has to know)
    except ModuleNotFoundError as error:
        return _fail(messages, "no bpy" if error.name == "bpy" else "bpy import", error)
    except ImportError as error:
        return _fail(messages, "bpy import", error)

    def report(done: int, total: int) -> None:
        print(json.dumps({"done": done, "total": total}), file=messages, flush=True)

    try:
        show_logs()
        importlib.import_module(f"hydroviews.blender.{module}").main(request, report)
    except InputError as error:
        return _fail(messages, "input", error)
    return 0


def _take_standard_output() -> TextIO:
    """Keep the pipe to the parent for messages and send descriptor 1, which Blender writes to, to the log."""
    messages = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    return messages


def _fail(messages: TextIO, kind: str, error: Exception) -> int:
    print(json.dumps({"failure": kind, "text": str(error)}), file=messages, flush=True)
    return 1


if __name__ == "__main__":
    sys.exit(main())
