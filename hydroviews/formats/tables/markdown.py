"""The one writer of Markdown tables: data cards, leaderboards, reports of networks."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

# What Markdown obeys within a line: marks of code, emphasis and strokes, cells, tags, entities, links. Of underscores
# those that begin an emphasis; between letters they do not.
OBEYED = re.compile(r"[\\`*|~]|<(?=[A-Za-z/!?])|&(?=#|[A-Za-z0-9]+;)|\](?=[(\[])|(?<!\S)_+(?=\S)|(?<=[^\w\s])_+(?=\w)")


class Markup(str):
    """A cell whose marks are meant: it is written as it is."""

    __slots__ = ()


def escaped(text: str) -> str:
    """Text that Markdown shows as it stands, in one line."""
    return OBEYED.sub(lambda found: "".join(f"\\{mark}" for mark in found[0]), " ".join(text.splitlines()))


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[Any]], keep_empty: bool = False) -> str:
    """A table in Markdown, without a final newline; columns that are empty in every row are left out unless kept.

    Cells are shown as they stand, but for `Markup`; the head is written as it is.

    Not `DataFrame.to_markdown`: that pads cells, so that one long name changes every line of a file under version
    control, and it writes numbers by formats of its own.
    """
    body = [[cell if isinstance(cell, Markup) else escaped(str(cell)) for cell in row] for row in rows]
    kept = [i for i in range(len(head)) if keep_empty or any(row[i] for row in body)] or [0]
    lines = [[head[i] for i in kept], ["---"] * len(kept), *([row[i] for i in kept] for row in body)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
