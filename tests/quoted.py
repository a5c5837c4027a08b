"""Numbers that the prose quotes and that no file in git has: ``results/quoted.csv``.

An expression over the runs, such as ``ratio(mean(rmse), PF)``, needs per_run.csv, which git does not
keep. `python -m tests.prose` evaluates it where the runs are there and records it here. Tests and clones
read the record, and a changed number is a line of `git diff`.
"""

import csv
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from trackbench.csv_writer import write_csv

RESULTS = Path(__file__).resolve().parent.parent / "results"
FILE = RESULTS / "quoted.csv"
HEADER = ["folder", "expression", "value", "stderr"]
_DIGITS = 7
Quoted = dict[tuple[str, str], tuple[float, ...]]
"""Value and standard error, or one number, by results folder and expression."""


@cache
def recorded() -> Quoted:
    """Return the recorded numbers."""
    if not FILE.is_file():
        return {}
    with FILE.open(encoding="utf-8", newline="") as file:
        return {
            (row["folder"], row["expression"]): tuple(
                float(row[name]) for name in ("value", "stderr") if row[name]
            )
            for row in csv.DictReader(file)
        }


def has_runs(folder: str) -> bool:
    """Return whether the values per run of a results folder are there."""
    return (RESULTS / folder / "per_run.csv").is_file()


def write_record(quoted: Mapping[tuple[str, str], tuple[float, ...]]) -> None:
    """Replace the record."""
    rows = (
        [*key, *(float(f"{x:.{_DIGITS}g}") for x in numbers), *[""] * (2 - len(numbers))]
        for key, numbers in sorted(quoted.items())
    )
    write_csv(FILE, HEADER, rows)
    recorded.cache_clear()
