"""The one exception for anything a user can mend, and guesses at what was meant."""

from collections.abc import Iterable
from difflib import get_close_matches


class InputError(Exception):
    """Bad input: what is wrong, what was found, what was expected, what to do.

    Command lines print it without a traceback and exit with status 2. Characters that a terminal would not show, or
    would obey, stand in it as escapes: servers, archives and file names may have any.

    Args:
        what: the problem in one sentence, naming the file or setting.
        found: what was there.
        expected: what should have been there.
        fix: what to do about it.
    """

    def __init__(self, what: object, *, found: object = None, expected: object = None, fix: str | None = None):
        lines = [str(what)]
        for label, value in (("found", found), ("expected", expected), ("what to do", fix)):
            if value is not None:
                lines.append(f"  {label}: {value}")
        super().__init__(printable("\n".join(lines)))


class MachineError(InputError):
    """Something is wrong with the machine: a full disk, a damaged file, no such device.

    It is nobody's fault who calculates there: a run of a method that meets it has not failed, it has not been made.
    """


def no_permission(path: object) -> InputError:
    """The error for a file or folder that the user is not allowed to open."""
    return InputError(f"{path}: no permission", fix="allow yourself to read it (chmod), or copy it as your own")


def printable(text: str) -> str:
    """The text with everything but printable characters and line ends written as Python's escapes."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


def unknown_name(
    where: str, name: str, kind: str, known: Iterable[str], otherwise: str = "", guess: str = ""
) -> InputError:
    """The error for a name that there is not: it lists those there are, and suggests the nearest.

    Args:
        where: what was given and for what, such as METHOD=3dgz.
        name: the name itself.
        kind: what it should name, such as method.
        known: all names there are.
        otherwise: what else could have been given.
        guess: what may have been meant where no known name is near.
    """
    names = list(dict.fromkeys(known))
    variants = [other for other in names if name and other.rpartition("-")[0] == name]  # none of them is nearer
    near = variants or get_close_matches(name, names, n=1) or ([guess] if guess else [])
    return InputError(
        f"{where}: no such {kind}",
        found=name,
        expected=f"one of {', '.join(names)}" + (f", or {otherwise}" if otherwise else ""),
        fix=f"did you mean {' or '.join(near)}?" if near else None,
    )
