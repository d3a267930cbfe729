"""Tables of benchmarks: measured case by case with progress, written as CSV, printed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from hydroviews.files.atomic import write_bytes

Row = Mapping[str, Any]


def rows_of(measure: Callable[..., Row], cases: Iterable[Sequence[Any]], title: str) -> pd.DataFrame:
    """A row for each case, measured one after another: `measure(*case)`."""
    return pd.DataFrame([measure(*case) for case in tqdm(list(cases), desc=title, unit="case", leave=False)])


def finished(path: Path, cases: Iterable[tuple[Row, Callable[[], Row | Sequence[Row]]]]) -> pd.DataFrame:
    """Rows of all cases: those that the file has are kept, the others are measured and written one by one.

    Args:
        path: the CSV file, with one folder for one set of settings.
        cases: of each the columns that name the case, and what measures its other columns, in one row or several.
    """
    table = pd.read_csv(path) if path.is_file() else pd.DataFrame()
    for case, measure in tqdm(list(cases), desc=path.stem, unit="case"):
        if len(table) and (table[list(case)] == list(case.values())).all(axis=1).any():
            continue
        found = measure()
        rows = pd.DataFrame([{**case, **row} for row in ([found] if isinstance(found, Mapping) else found)])
        table = pd.concat([table, rows], ignore_index=True) if len(table) else rows
        write_csv(table, path)
    return table


def report(table: pd.DataFrame, path: Path, title: str = "", style: str = "{:.4g}") -> None:
    """Write a table as CSV and print it, numbers with fractions in a style."""
    write_csv(table, path)
    print(f"\n{title}\n{table.to_string(index=False, float_format=style.format)}".replace("\n\n", "\n"), flush=True)


def write_csv(table: pd.DataFrame, path: Path) -> None:
    """Write a table whole or not at all, numbers with six digits."""
    write_bytes(path, table.to_csv(index=False, float_format="%.6g").encode())
