"""Every benchmark is a command; cases that a table has are kept, and seconds are counted."""

import importlib
import subprocess
import sys

import pandas as pd
import pytest

from benchmarks.__main__ import BENCHMARKS
from benchmarks.tables import finished, report, rows_of
from benchmarks.timing import counted, counted_seconds


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_name_has_a_command(name):
    assert callable(importlib.import_module(f"benchmarks.{BENCHMARKS[name]}").main)


def test_names_are_listed_and_others_refused():
    listed = subprocess.run([sys.executable, "-m", "benchmarks"], capture_output=True, text=True, check=True).stdout
    assert [line.split()[0] for line in listed.splitlines()[2:]] == list(BENCHMARKS)
    wrong = subprocess.run([sys.executable, "-m", "benchmarks", "nonsense"], capture_output=True, text=True)
    assert wrong.returncode == 2
    assert "nonsense: no such benchmark" in wrong.stderr


def test_finished_cases_are_kept(tmp_path):
    path = tmp_path / "table.csv"
    assert finished(path, [({"case": "a", "seed": 0}, lambda: {"PSNR": 20.125})])["PSNR"].tolist() == [20.125]

    def interrupted() -> dict:
        raise KeyboardInterrupt

    cases = [({"case": "a", "seed": 0}, interrupted), ({"case": "b", "seed": 0}, lambda: [{"PSNR": 1}, {"PSNR": 2}])]
    with pytest.raises(KeyboardInterrupt):
        finished(path, [*cases, ({"case": "c", "seed": 0}, interrupted)])
    assert pd.read_csv(path)["case"].tolist() == ["a", "b", "b"]


def test_a_report_is_printed_and_written(tmp_path, capsys):
    table = rows_of(lambda a, b: {"sum": a + b}, [(1, 2.5), (3, 4.0)], "sums")
    report(table, tmp_path / "sums.csv", "sums")
    assert capsys.readouterr().out.splitlines()[-3:] == [" sum", " 3.5", "   7"]
    assert pd.read_csv(tmp_path / "sums.csv")["sum"].tolist() == [3.5, 7]


def test_seconds_of_several_sessions_add_up(tmp_path):
    total = tmp_path / "seconds.txt"
    assert counted_seconds(total) == 0
    with pytest.raises(KeyboardInterrupt), counted(total):
        sum(range(2_000_000))
        raise KeyboardInterrupt
    once = counted_seconds(total)
    assert once > 0
    with counted(total):
        sum(range(2_000_000))
    assert counted_seconds(total) > once
