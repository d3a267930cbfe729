"""What others add to the benchmark, found by name: an entry point of a group, or `package.module:member`."""

import importlib
import os
import sys
import traceback
from importlib.metadata import entry_points
from pathlib import PurePath
from typing import Any

from hydroviews.cli.processes import Ended
from hydroviews.errors import InputError, unknown_name


def registered(group: str) -> dict[str, str]:
    """`package.module:member` of each entry point of a group, by name, sorted."""
    return {point.name: point.value for point in sorted(entry_points(group=group), key=lambda point: point.name)}


def load_plugin(where: str, name: str, group: str, kind: str, own: str) -> Any:
    """What a name stands for.

    Args:
        where: what was given and for what, such as METHOD=3dgz, for errors.
        name: of an entry point, or `package.module:member`.
        group: of the entry points.
        kind: what it should be, such as method, for errors.
        own: what a member of one's own is, Class or function, for errors.

    Raises:
        InputError: there is no such name, or it cannot be imported; then with the lines that led there.
    """
    # Entry points are searched on disk: not where the name says all.
    known = {} if ":" in name else registered(group)
    target = known.get(name, name)
    module, _, member = target.partition(":")
    expected = f"package.module:{own} for your own"
    if module.endswith(".py") or (member and "/" in module):
        stem = PurePath(module).stem
        fix = f"{stem}:{member or own}, started from the folder that {stem}.py lies in"
        raise InputError(f"{where}: a file", found=module, expected=expected, fix=fix)
    if not (module and member) or module.startswith("."):
        package, _, last = module.rpartition(".")
        guess = f"{package}:{last}" if package and last else ""
        raise unknown_name(where, name, kind, registered(group), expected, guess)
    try:
        if os.getcwd() not in sys.path:  # one's own module, however the command was started
            sys.path.append(os.getcwd())
        return getattr(importlib.import_module(module), member)
    except Ended:  # by a signal, not by the module
        raise
    except (Exception, SystemExit) as error:  # whatever stands in a user's module, such as a script that runs
        there = _members(module, member)
        raise InputError(f"{where}: cannot import {target}", found=_why(error), expected=there) from error


def _members(module: str, member: str) -> str | None:
    """What a module has instead of a member that it has not; None where that is not what is wrong."""
    contents = vars(sys.modules[module]) if module in sys.modules else {}
    own = [name for name, value in contents.items() if getattr(value, "__module__", None) == module and name[0] != "_"]
    return f"one of {', '.join(own)}" if own and member not in contents else None


def _why(error: BaseException) -> str:
    """What went wrong, with the lines of the user's modules that led there; none for a module that is not there."""
    told = traceback.TracebackException.from_exception(error)
    told.stack[:] = [frame for frame in told.stack if not _is_machinery(frame.filename)]
    lines = told.format() if told.stack else told.format_exception_only()
    return "".join(lines).rstrip().replace("\n", "\n    ")


def _is_machinery(file: str) -> bool:
    return file == __file__ or file == importlib.__file__ or file.startswith("<frozen importlib")
