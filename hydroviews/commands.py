"""How every command line of the project ends: plain errors, a kind word on interruption."""

import signal
import sys
from collections.abc import Callable, Mapping

import tyro

from hydroviews.errors import InputError


def run_command(commands: Mapping[str, Callable[..., None]], prog: str) -> None:
    """Run the named subcommand; exit 2 on bad input, 130 on Ctrl-C, 143 when asked to end."""
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        tyro.extras.subcommand_cli_from_dict(dict(commands), prog=prog)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        sys.exit(130)
