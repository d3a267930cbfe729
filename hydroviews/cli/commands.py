"""How every command of the project runs and ends."""

import importlib
import os
import signal
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

import tyro

from hydroviews.cli.logs import choose_log_level, show_logs
from hydroviews.cli.malloc import keep_freed_memory
from hydroviews.cli.processes import ENDING, Ended, end_when_asked
from hydroviews.cli.starting import ENDED
from hydroviews.errors import InputError, no_permission

HELP = "With any command, anywhere: --verbose shows times, modules and details, --quiet warnings only."


def run_command(
    commands: Mapping[str, Callable[..., Any] | str] | Callable[..., Any],
    prog: str,
    groups: Mapping[str, Iterable[str]] | None = None,
) -> None:
    """Run the named subcommand, or the one command there is, with messages shown as asked for.

    Args:
        commands: by name; a text, `package.module:function`, is imported once it is asked for.
        prog: the program's name, for its help.
        groups: names of commands by what they are for, for the help.

    Exits 2 on bad input and where a file may not be opened, 130 on Ctrl-C, 141 when nobody reads its output, 143 on
    SIGTERM, 129 when its terminal is closed.
    """
    end_when_asked()
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # since the first line of a `__main__`
        signal.signal(signal.SIGINT, signal.default_int_handler)
    keep_freed_memory()
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # see `processes.deferred_interrupts`
        arguments = choose_log_level(sys.argv[1:])
        sys.argv = sys.argv[:1]  # methods and other plugins may read it, and these arguments are not theirs
        show_logs()
        if callable(commands):
            tyro.cli(commands, prog=prog, args=arguments)
        elif arguments and arguments[0] in commands:  # no other command's module is imported
            tyro.cli(imported(commands[arguments[0]]), prog=f"{prog} {arguments[0]}", args=arguments[1:])
        else:
            text = "\n\n".join([*(f"To {what}: {', '.join(names)}." for what, names in (groups or {}).items()), HELP])
            known = {name: imported(command) for name, command in commands.items()}
            tyro.extras.subcommand_cli_from_dict(known, prog=prog, description=text, args=arguments)
    except InputError as error:
        _refuse(error)
    except PermissionError as error:
        if error.filename is None:
            raise
        _refuse(no_permission(error.filename))
    except BrokenPipeError:  # whoever read the output has seen enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to be flushed at exit
        sys.exit(141)
    except KeyboardInterrupt:
        _end("\ninterrupted; the same command goes on from here", 130)
    except Ended as end:
        _end(ENDED.format(end.name), end.code)


def imported(command: Callable[..., Any] | str) -> Callable[..., Any]:
    """A command's function, which may be given as `package.module:function`."""
    if callable(command):
        return command
    module, _, function = command.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return found


def _end(text: str, status: Any) -> NoReturn:
    """End with a line; further signals would only make a traceback of what is left to do."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    print(text, file=sys.stderr)
    sys.exit(status)


def _refuse(error: InputError) -> NoReturn:
    print(f"error: {error}", file=sys.stderr)
    sys.exit(2)


def choices(names: Iterable[str], otherwise: str = "") -> Any:
    """For `Annotated[str, choices(...)]`: shows in a command's help what may be given.

    What is given is checked where it is used, so that Python and every command line get the same error.
    """
    return tyro.conf.arg(metavar="{" + ",".join([*names, *([otherwise] if otherwise else [])]) + "}")
