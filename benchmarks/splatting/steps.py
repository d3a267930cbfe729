"""Speed of training steps, kernel by kernel, and their error against float64.

    python -m benchmarks splatting --folder results/bench

Prints tables and writes them as splatting-*.csv, and growth.html with the curves of how time grows.
"""

from pathlib import Path
from typing import Literal

from baselines.splatting.backends.warm_up import warm_up
from benchmarks.splatting.curves import growth_curves
from benchmarks.splatting.error import cutoffs, precision
from benchmarks.splatting.speed import colours, growth, speeds
from benchmarks.tables import report
from hydroviews.files.atomic import write_bytes

Part = Literal["speed", "growth", "colours", "precision", "cutoffs"]
TITLES: dict[Part, str] = {
    "speed": "milliseconds",
    "growth": "milliseconds",
    "colours": "milliseconds",
    "precision": "error against float64 with the same cut-offs",
    "cutoffs": "float64 with cut-offs against float64 without",
}


def main(
    folder: Path = Path("results/bench"),
    repeats: int = 15,
    parts: tuple[Part, ...] = tuple(TITLES),
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
        report(table, folder / f"splatting-{part}.csv", TITLES[part])
        if part == "growth":
            write_bytes(folder / "growth.html", growth_curves(table).encode())
