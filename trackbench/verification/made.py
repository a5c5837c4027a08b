"""Tables, pairs, verdicts and sweep.csv, made again from what is stored of the runs."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trackbench.report.comparison import FILES, write_comparison, write_paired
from trackbench.report.render import write_tables
from trackbench.report.results import Results
from trackbench.report.sweep import write_sweep
from trackbench.report.times import FILE as TIMES
from trackbench.report.verdicts import compare
from trackbench.verification.findings import Finding, changed, rounding
from trackbench.verification.rounding import relative

_LAST_DIGITS = 1e-6
"""Share of a number that the order of a sum may change in it."""


def made_again(results: Results) -> Iterator[Finding]:
    """What differs from the files that are made again, which are written to the results' target."""
    write_tables(results, tex=True)
    for what, line in zip(results.unmade, results.unmade_lines, strict=True):
        if (results.folder / "tables" / f"{what.removeprefix('table ')}.csv").is_file():
            yield changed(line)
    write_paired(results)
    write_comparison(results, compare(results))
    if (results.folder / "sweep.csv").is_file():
        write_sweep(results)
    again = {p.relative_to(results.target) for p in results.target.rglob("*") if p.is_file()}
    for name in sorted(again):
        stored, found = results.folder / name, results.target / name
        if not stored.is_file() and name.suffix != ".tex":
            yield changed(f"{name}: is not there")
        elif stored.is_file() and stored.read_bytes() != found.read_bytes():
            yield _difference(name, stored, found)
    for name in map(Path, (*FILES, TIMES)):
        if (results.folder / name).is_file() and name not in again:
            yield changed(f"{name}: nothing is published about this experiment")


def _difference(name: Path, stored: Path, found: Path) -> Finding:
    a, b = _rows(stored), _rows(found)
    pairs = [(x, y) for x, y in zip(a, b, strict=False) if x != y]
    if len(a) != len(b):
        return changed(f"{name}: has {len(a)} lines, of the stored runs it has {len(b)}")
    shares = [share for x, y in pairs for share in _shares(x, y)]
    if name.suffix == ".csv" and max(shares, default=0.0) <= _LAST_DIGITS:
        return rounding(f"{name}: {len(shares)} numbers differ, by {max(shares):.1e} at most")
    x, y = (",".join(row) for row in pairs[0])
    what = f"{len(pairs)} rows do not follow from the stored runs; the first is"
    return changed(f"{name}: {what} {x!r}, it should be {y!r}")


def _rows(path: Path) -> list[list[str]]:
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".csv":
        return list(csv.reader(io.StringIO(text, newline="")))
    return [[line] for line in text.splitlines()]


def _shares(x: list[str], y: list[str]) -> Iterator[float]:
    """How far the cells of two rows that differ are apart; infinite unless both are numbers."""
    if len(x) != len(y):
        yield np.inf
    for a, b in zip(x, y, strict=False):
        if a != b:
            try:
                yield float(relative(np.array(float(a)), np.array(float(b))))
            except ValueError:
                yield np.inf
