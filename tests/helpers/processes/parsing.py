"""Commands as their parsers take them: nothing is run."""

import contextlib
import functools
import importlib.util
import io
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import tyro

HOOKS = Path(__file__).parents[3] / "docs" / "hooks.py"


@functools.cache
def docs_hooks() -> ModuleType:
    """What the pages of commands, settings and the API are written by."""
    spec = importlib.util.spec_from_file_location("docs_hooks", HOOKS)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@functools.cache
def documented_commands() -> dict[str, Callable]:
    """The function behind every subcommand by its line, such as `hydroviews build`."""
    return docs_hooks().commands()


def refusal(function: Callable, words: list[str]) -> str:
    """What the command's parser says against these arguments; empty if it takes them."""

    @functools.wraps(function)
    def nothing(*_, **__):
        pass

    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            tyro.cli(nothing, args=words)
    except SystemExit:
        return out.getvalue()
    return ""
