"""What strangers write is shown as it stands: a spreadsheet runs none of it, and Markdown obeys none of it."""

import csv

import numpy as np
import pandas as pd
import pytest

from hydroviews.formats.tables.csv_tables import csv_bytes, read_csv, write_csv
from hydroviews.formats.tables.markdown import Markup, markdown_table

RUN = ["=1+1", '=HYPERLINK("http://evil.example")', "+1", "-1+cmd|'/c calc'!A0", "@SUM(1)", "\t=1", "\n=1", "＝1+1"]  # noqa: RUF001
PLAIN = ["3dgs+enhance", "a=b", "007", "", "O'Brien", "'quoted'", "a, b", "Müller"]


@pytest.mark.parametrize("kind", [object, "string", "category"])
@pytest.mark.parametrize("text", RUN)
def test_no_cell_is_run_by_a_spreadsheet_and_all_are_read_as_they_were(tmp_path, text, kind):
    table = pd.DataFrame({"who": pd.Series([text, f"'{text}", "plain"], dtype=kind), "psnr": [-1.5, 2.0, np.nan]})
    write_csv(tmp_path / "table.csv", table)
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        cells = [row["who"] for row in csv.DictReader(file)]
    assert cells == [f"'{text}", f"''{text}", "plain"]
    found = read_csv(tmp_path / "table.csv", texts=["who"])
    assert list(found.who) == [text, f"'{text}", "plain"]
    assert list(found.psnr[:2]) == [-1.5, 2.0]


def test_other_cells_and_numbers_are_as_ever():
    table = pd.DataFrame({"who": PLAIN, "n": pd.array([*range(-4, 3), None], dtype="Int64")})
    assert csv_bytes(table) == table.to_csv(index=False, lineterminator="\n").encode()


def test_a_carriage_return_begins_no_row():
    text = csv_bytes(pd.DataFrame({"who": ["a\r=1+1"], "n": [1]})).decode()
    assert list(csv.reader(text.splitlines(keepends=True))) == [["who", "n"], ["a\n=1+1", "1"]]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("2 x A100 | 80 GB", r"2 x A100 \| 80 GB"),
        ("a\\|b", r"a\\\|b"),
        ("first\nsecond\r\nthird", "first second third"),
        ("**best**", r"\*\*best\*\*"),
        ("<b>bold</b>", r"\<b>bold\</b>"),
        ("<!-- hidden", r"\<!-- hidden"),
        ("`code`", r"\`code\`"),
        ("[text](http://evil.example)", r"[text\](http://evil.example)"),
        ("![x][y]", r"![x\][y]"),
        ("&lt;u&#62;", r"\&lt;u\&#62;"),
        ("_emphasis_ __init__", r"\_emphasis_ \_\_init__"),
        ("(_so_)", r"(\_so_)"),
        ("ours_&_%", "ours_&_%"),
        ("~~gone~~", r"\~\~gone\~\~"),
        ("mipnerf360_bonsai", "mipnerf360_bonsai"),
        ("12.3 [11.2, 13.1], p < 0.05, A & B", "12.3 [11.2, 13.1], p < 0.05, A & B"),
        (Markup("**12.3**"), "**12.3**"),
    ],
)
def test_a_cell_of_markdown_is_shown_as_it_stands(text, shown):
    assert markdown_table(("method", "n"), [(text, 3)]).splitlines()[2:] == [f"| {shown} | 3 |"]
