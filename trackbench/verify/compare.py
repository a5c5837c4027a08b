"""What is stored beside the values per run, held against the same computed again."""

import csv
import io
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.render import write_tables
from trackbench.report.results import Results
from trackbench.report.sweep import write_sweep
from trackbench.report.verdicts.cpu_times import FILE as TIMES
from trackbench.report.verdicts.files import FILES, write_comparison, write_paired
from trackbench.report.verdicts.numbers import compare
from trackbench.verify.findings import Finding, changed, rounding
from trackbench.verify.rounding import ROUNDING, relative

if TYPE_CHECKING:
    import pandas as pd

_GRAIN = 2e-3
"""Share of its span that a drawn track is rounded to, at most."""


def same_rows(
    results: Results, again: Results, labels: Collection[str | None]
) -> Iterator[Finding]:
    """What differs in the rows of summary.csv and per_step.csv of these labels."""
    for name in ("summary", "per_step"):
        a, b = (_rows(getattr(of, name), labels) for of in (results, again))
        keys = [column for column in b if column not in ("value", "stderr")]
        if not a[keys].equals(b[keys]):
            yield changed(f"{name}.csv: has other rows than are computed again")
            continue
        usual = (
            b["value"].abs().groupby([b[k] for k in keys if k not in _OF_STEPS]).transform("median")
        )
        scale = np.fmax(usual.to_numpy(), b["stderr"].abs().to_numpy())
        ends = [
            relative(a[end].to_numpy(), b[end].to_numpy(), scale) for end in ("value", "stderr")
        ]
        off = np.max(ends, axis=0, initial=0.0)
        if off.any():
            yield _finding(
                f"{name}.csv: {np.count_nonzero(off)} of {len(off)} rows differ", off, ROUNDING
            )


def same_arrays(
    results: Results, again: Results, name: str, labels: Collection[str]
) -> Iterator[Finding]:
    """What differs in a file of tracks; of filters only in those of these labels."""
    stored, now = results.arrays(name), again.arrays(name)
    if stored.keys() != now.keys():
        yield changed(f"{name}: holds other arrays than are computed again")
        return
    for key, array in now.items():
        inner = key.partition("/")[2] if key.startswith("point") else key
        label = inner.partition("/")[2]
        if label and label not in labels:
            continue
        first = stored[key][..., : array.shape[-1]]
        off = relative(first, array, np.abs(array[np.isfinite(array)]).max(initial=0.0))
        if off.any():
            least = _GRAIN if array.dtype == np.float32 else ROUNDING
            yield _finding(f"{name}: {key} differs", off, least)


def _finding(what: str, off: Array, least: float) -> Finding:
    by = f"{what} by {off.max():.1e} at most"
    return rounding(by) if off.max() <= least else changed(f"{by}, more than rounding")


def _rows(frame: "pd.DataFrame", labels: Collection[str | None]) -> "pd.DataFrame":
    return frame[frame["filter"].isin(list(labels))].reset_index(drop=True)


_OF_STEPS = ("step", "time", "runs", "lost")


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
    a, b = _cells(stored), _cells(found)
    pairs = [(x, y) for x, y in zip(a, b, strict=False) if x != y]
    if len(a) != len(b):
        return changed(f"{name}: has {len(a)} lines, of the stored runs it has {len(b)}")
    shares = [share for x, y in pairs for share in _shares(x, y)]
    if name.suffix == ".csv" and max(shares, default=0.0) <= _LAST_DIGITS:
        return rounding(f"{name}: {len(shares)} numbers differ, by {max(shares):.1e} at most")
    x, y = (",".join(row) for row in pairs[0])
    what = f"{len(pairs)} rows do not follow from the stored runs; the first is"
    return changed(f"{name}: {what} {x!r}, it should be {y!r}")


def _cells(path: Path) -> list[list[str]]:
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
