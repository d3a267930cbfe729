"""Tables as CSV files that a spreadsheet shows: a cell that it would calculate gets an apostrophe before it.

Names of photographs, methods and people stand in these files, and a spreadsheet runs what begins with "=". What is
read here again is as it was.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydroviews.files.atomic import as_file, replacing

if TYPE_CHECKING:
    import pandas as pd

RUN = re.compile(r"'*[=+\-@\t\n\uff1d\uff0b\uff0d\uff20]")  # the last four as wide as Chinese characters
APOSTROPHE = "'"


def neutral(value: Any) -> Any:
    """A cell that no spreadsheet runs; numbers stay. A carriage return, which would begin a row, is a new line."""
    if not isinstance(value, str):
        return value
    text = value.replace("\r", "\n")
    return APOSTROPHE + text if RUN.match(text) else text


def as_written(cell: str) -> str:
    """The text that `neutral` was given."""
    return cell[1:] if cell.startswith(APOSTROPHE) and RUN.match(cell) else cell


def csv_bytes(table: "pd.DataFrame") -> bytes:
    """A table as the content of a CSV file, without its index."""
    from pandas.api.types import is_numeric_dtype

    texts = [str(name) for name in table if not is_numeric_dtype(table[name].dtype)]
    safe = table.assign(**{name: table[name].astype(object).map(neutral) for name in texts})
    return safe.to_csv(index=False, lineterminator="\n").encode()


def write_csv(path: Path, table: "pd.DataFrame") -> None:
    """Write a table, without its index, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_bytes(csv_bytes(table))


def read_csv(source: Any, texts: Sequence[str] = (), **options: Any) -> "pd.DataFrame":
    """Read a table that `write_csv` wrote.

    Args:
        source: a path or an open file.
        texts: columns that hold text, whatever it looks like: 007 is a name.
        options: as `pandas.read_csv` has them.

    Raises:
        InputError: something else than a file has that name.
        OSError, ValueError: there is no such file, it cannot be read, or is no table.
    """
    import pandas as pd

    if isinstance(source, Path):
        as_file(source)
    return pd.read_csv(source, converters=dict.fromkeys(texts, as_written), **options)
