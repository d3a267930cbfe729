"""The one exception for anything a user can mend, and guesses at what was meant."""

from collections.abc import Iterable
from difflib import get_close_matches


class InputError(Exception):
    """Bad input, told in the order a reader needs it.

    Command lines print it without a traceback and exit with status 2.

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
        super().__init__("\n".join(lines))


def unknown_name(setting: str, name: str, kind: str, known: Iterable[str], otherwise: str = "") -> InputError:
    """The error for a name that there is not: it lists those there are, and suggests the nearest.

    Args:
        setting: where it was named, such as METHOD.
        name: what was given.
        kind: what it should name, such as method.
        known: all names there are.
        otherwise: what else could have been given.
    """
    names = list(dict.fromkeys(known))
    near = get_close_matches(name, names, n=1)
    expected = f"one of {', '.join(names)}" + (f", or {otherwise}" if otherwise else "")
    fix = f"did you mean {near[0]}?" if near else None
    return InputError(f"{setting}={name}: no such {kind}", expected=expected, fix=fix)
