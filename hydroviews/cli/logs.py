"""Messages on the command line: which are shown, and where."""

import argparse
import logging
import os
import sys
from collections.abc import Sequence

from tqdm import tqdm

from hydroviews.errors import InputError

PACKAGES = ("hydroviews", "baselines", "deraings", "leaderboard", "benchmarks")  # whose messages are shown
LOG_LEVEL = "HYDROVIEWS_LOG_LEVEL"  # DEBUG, INFO or WARNING; processes that a command starts inherit it
PLAIN, DETAILED = "%(message)s", "%(asctime)s %(levelname)s %(name)s: %(message)s"


def choose_log_level(arguments: Sequence[str]) -> list[str]:
    """Take `--verbose` and `--quiet` out of a command's arguments and set $HYDROVIEWS_LOG_LEVEL by them."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--verbose", dest="level", action="store_const", const="DEBUG")
    choice.add_argument("--quiet", dest="level", action="store_const", const="WARNING")
    found, rest = parser.parse_known_args(arguments)
    if found.level:
        os.environ[LOG_LEVEL] = found.level
    return rest


def show_logs() -> None:
    """Show the project's messages: warnings on standard error, others on standard output; nobody else's.

    Raises:
        InputError: $HYDROVIEWS_LOG_LEVEL is no level.
    """
    level = os.environ.get(LOG_LEVEL, "INFO")
    if level not in ("DEBUG", "INFO", "WARNING"):
        raise InputError(f"{LOG_LEVEL}={level}: no such level", expected="DEBUG, INFO or WARNING")
    handler = _Console()
    handler.setFormatter(logging.Formatter(DETAILED if level == "DEBUG" else PLAIN))
    for package in PACKAGES:
        logger = logging.getLogger(package)
        logger.setLevel(level)
        logger.handlers[:] = [handler]


class _Console(logging.Handler):
    """Writes whole lines above tqdm's bars, to the standard streams as they are at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            stream = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
            tqdm.write(self.format(record), file=stream)
            stream.flush()
        except Exception:
            self.handleError(record)
