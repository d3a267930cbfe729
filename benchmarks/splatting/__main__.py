"""Speed of training steps, kernel by kernel, and their error against float64.

    python -m benchmarks.splatting --folder results/bench

Prints tables and writes them as splatting-*.csv, and growth.html with the curves of how time grows.
"""

from pathlib import Path
from typing import Literal

import pandas as pd

from baselines.splatting.backends.warm_up import warm_up
from benchmarks.splatting.curves import growth_curves
from benchmarks.splatting.error import cutoffs, precision
from benchmarks.splatting.speed import colours, growth, speeds
from hydroviews.cli.commands import run_command
from hydroviews.files.atomic import write_bytes

Part = Literal["speed", "growth", "colours", "precision", "cutoffs"]


def main(
    folder: Path = Path("results/bench"),
    repeats: int = 15,
    parts: tuple[Part, ...] = ("speed", "growth", "colours", "precision", "cutoffs"),
) -> None:
    """Measure and report.

    Args:
        folder: where the files go.
        repeats: timed steps of each case, after three that are not.
        parts: what to measure.
    """
    print(f"kernels ready after {warm_up(3):.1f} s")
    measure = {
        "speed": lambda: speeds(repeats),
        "growth": lambda: growth(repeats),
        "colours": lambda: colours(repeats),
        "precision": precision,
        "cutoffs": cutoffs,
    }
    for part in parts:
        table = measure[part]()
        report(part, table)
        write_bytes(folder / f"splatting-{part}.csv", table.to_csv(index=False).encode())
        if part == "growth":
            write_bytes(folder / "growth.html", growth_curves(table).encode())


def report(part: str, table: pd.DataFrame) -> None:
    """Print a table, small numbers with two digits."""
    titles = {
        "speed": "milliseconds",
        "growth": "milliseconds",
        "colours": "milliseconds",
        "precision": "error against float64 with the same cut-offs",
        "cutoffs": "float64 with cut-offs against float64 without",
    }
    style = "{:.2f}".format if part in ("speed", "growth", "colours") else "{:.1e}".format
    print(f"\n{titles[part]}\n{table.to_string(index=False, float_format=style)}")


if __name__ == "__main__":
    run_command(main, prog="benchmarks.splatting")
