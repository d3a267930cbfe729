"""The project's commands, run within the process of the tests: starting Python takes longer than most of them."""

import io
import logging
import os
import runpy
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest import mock

from hydroviews.cli.logs import PACKAGES
from hydroviews.cli.processes import ASKED


@dataclass(frozen=True)
class Done:
    """What a command came to."""

    returncode: int
    stdout: str
    stderr: str


def command(module: str, *arguments: str) -> Done:
    """Run `python -m MODULE ARGUMENTS` up to its end; what it does to this process is undone."""
    output, errors, status = io.StringIO(), io.StringIO(), 0
    with (
        _undone(),
        mock.patch.object(sys, "argv", [module, *arguments]),
        redirect_stdout(output),
        redirect_stderr(errors),
    ):
        try:
            runpy.run_module(module, run_name="__main__")
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
    return Done(status, output.getvalue(), errors.getvalue())


@contextmanager
def _undone() -> Iterator[None]:
    """Keep arguments, environment, handlers of signals and the loggers as they are."""
    loggers = [logging.getLogger(name) for name in PACKAGES]
    before = [(logger.level, logger.handlers[:]) for logger in loggers]
    handlers = {number: signal.getsignal(number) for number in ASKED}
    with mock.patch.dict(os.environ), mock.patch.object(sys, "argv", sys.argv), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'.*__main__' found in sys.modules", RuntimeWarning)  # tests import it too
        try:
            yield
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
            for logger, (level, shown) in zip(loggers, before, strict=True):
                logger.setLevel(level)
                logger.handlers[:] = shown
