"""The one writer of Markdown tables: data cards, leaderboards, reports of networks."""

from collections.abc import Iterable, Sequence
from typing import Any


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[Any]], keep_empty: bool = False) -> str:
    """A table in Markdown, without a final newline; columns that are empty in every row are left out unless kept.

    Not `DataFrame.to_markdown`: that pads cells, so that one long name changes every line of a file under version
    control, and it writes numbers by formats of its own.
    """
    body = [[str(cell) for cell in row] for row in rows]
    kept = [i for i in range(len(head)) if keep_empty or any(row[i] for row in body)] or [0]
    lines = [[head[i] for i in kept], ["---"] * len(kept), *([row[i] for i in kept] for row in body)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
