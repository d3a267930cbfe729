"""The files that hold tables: Markdown to read, LaTeX to print, CSV to calculate with."""

from pathlib import Path

import pandas as pd

from hydroviews.files.atomic import write_bytes
from hydroviews.formats.tables.csv_tables import write_csv
from leaderboard.tables.dataframes import all_tables, tidy_ablation, tidy_scenes, tidy_suites
from leaderboard.tables.latex import to_latex
from leaderboard.tables.markdown import all_text

TABLES, LATEX = "tables.md", "tables.tex"
SCENES_CSV, GRADES_CSV, COSTS_CSV, ABLATION_CSV = "tables.csv", "grades.csv", "costs.csv", "ablation.csv"


def write_tables(table: pd.DataFrame, results: Path) -> None:
    """Write TABLES, LATEX, and what they show as tidy CSVs."""
    tables = all_tables(table)
    write_bytes(results / TABLES, all_text(tables).encode())
    write_bytes(results / LATEX, to_latex(tables).encode())
    files = {
        SCENES_CSV: tidy_scenes(tables),
        GRADES_CSV: tidy_suites(tables, "grades"),
        COSTS_CSV: tidy_suites(tables, "costs"),
        ABLATION_CSV: tidy_ablation(tables),
    }
    for name, content in files.items():
        write_csv(results / name, content)
