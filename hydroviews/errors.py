"""The one exception for anything the user can correct."""


class InputError(Exception):
    """Bad input: what is wrong, what was found, what was expected, what to do.

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
