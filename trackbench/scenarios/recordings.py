"""Recorded series from a CSV: one row per run and step, checked line by line."""

import csv
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.keys import DataError, Place

_MOST_CELLS = 200_000_000
_MOST_MISTAKES = 20


class Recording(NamedTuple):
    """Values (n, T, M) by component, step and run, NaN where there is no row; the runs' numbers."""

    values: Array
    runs: list[int]


class _Row(NamedTuple):
    line: int
    run: int
    step: int
    values: list[float]


def read_recording(path: str, components: Sequence[str], steps: Sequence[int]) -> Recording:
    """Columns ``run``, ``step`` and the components; rows of a run in the order of their steps.

    Cells that are empty or ``nan`` are missing, other columns are not looked at. Raises DataError
    with the line of every mistake.
    """
    rows = list(_checked(path, components, steps))
    runs = sorted({row.run for row in rows})
    if len(components) * len(steps) * len(runs) > _MOST_CELLS:
        raise DataError(Place(path, 1, 1, f"{len(runs)} runs of {len(steps)} steps are too many"))
    values = np.full((len(components), len(steps), len(runs)), np.nan)
    column = {run: m for m, run in enumerate(runs)}
    position = {step: i for i, step in enumerate(steps)}
    for row in rows:
        values[:, position[row.step], column[row.run]] = row.values
    return Recording(values, runs)


def read_columns(path: str, wanted: Sequence[str], optional: Sequence[str]) -> dict[str, Array]:
    """Columns of finite numbers by name, in this order: those that are wanted, and others if there.

    Raises DataError with the line of every mistake.
    """
    lines = _lines(path)
    line, header = next(lines, (1, []))
    names = [name.strip() for name in header]
    known = [name for name in (*wanted, *optional) if name in names]
    for name in wanted:
        if names.count(name) != 1:
            what = f"no column {name}" if name not in names else f"two columns {name}"
            raise DataError(Place(path, line, 1, what))
    rows, mistakes = [], []
    for line, cells in lines:
        try:
            if len(cells) != len(names):
                raise ValueError(f"{len(cells)} cells under {len(names)} columns")
            rows.append([_finite(name, cells[names.index(name)].strip()) for name in known])
        except ValueError as error:
            mistakes.append(Place(path, line, 1, str(error)))
        if len(mistakes) >= _MOST_MISTAKES:
            break
    if not rows and not mistakes:
        mistakes.append(Place(path, 1, 1, "has no rows"))
    if mistakes:
        raise DataError(*mistakes)
    return dict(zip(known, np.array(rows).T, strict=True))


def _finite(name: str, cell: str) -> float:
    try:
        value = _number(cell)
    except ValueError as error:
        raise ValueError(f"{name}: {cell[:40]!r} is not {error}") from None
    if math.isnan(value):
        raise ValueError(f"{name}: is missing")
    return value


def _checked(path: str, components: Sequence[str], steps: Sequence[int]) -> Iterator[_Row]:
    mistakes: list[Place] = []
    last: dict[int, int] = {}
    known = set(steps)
    number = 0
    for row in _rows(path, components, mistakes):
        number += 1
        before = last.get(row.run)
        if before is not None and row.step <= before:
            what = "is there twice" if row.step == before else f"comes after step {before}"
            mistakes.append(Place(path, row.line, 1, f"run {row.run}: step {row.step} {what}"))
        elif row.step not in known:
            what = f"run {row.run}: step {row.step} is not one of {steps[0]} to {steps[-1]}"
            mistakes.append(Place(path, row.line, 1, what))
        last[row.run] = row.step
        if len(mistakes) >= _MOST_MISTAKES:
            break
        yield row
    if not number and not mistakes:
        mistakes.append(Place(path, 1, 1, "has no rows"))
    if mistakes:
        raise DataError(*mistakes)


def _rows(path: str, components: Sequence[str], mistakes: list[Place]) -> Iterator[_Row]:
    wanted = ["run", "step", *components]
    lines = _lines(path)
    line, header = next(lines, (1, []))
    names = [name.strip() for name in header]
    missing = [name for name in wanted if name not in names]
    twice = [name for name in wanted if names.count(name) > 1]
    if missing or twice:
        what = f"no column {missing[0]}" if missing else f"two columns {twice[0]}"
        columns = ",".join(wanted)
        raise DataError(Place(path, line, 1, f"{what}; the columns must be {columns}"))
    places = [names.index(name) for name in wanted]
    for line, cells in lines:
        if len(cells) != len(names):
            what = f"{len(cells)} cells under {len(names)} columns"
            mistakes.append(Place(path, line, 1, what))
            continue
        row = _row(path, line, wanted, [cells[i].strip() for i in places], mistakes)
        if row is not None:
            yield row


def _row(
    path: str, line: int, names: list[str], cells: list[str], mistakes: list[Place]
) -> _Row | None:
    found: list[float] = []
    for i, (name, cell) in enumerate(zip(names, cells, strict=True)):
        try:
            found.append(_whole(cell) if i < 2 else _number(cell))
        except ValueError as error:
            mistakes.append(Place(path, line, 1, f"{name}: {cell[:40]!r} is not {error}"))
            return None
    return _Row(line, int(found[0]), int(found[1]), found[2:])


def _whole(cell: str) -> int:
    if not (cell.isascii() and cell.isdigit() and len(cell) < 10):
        raise ValueError("a whole number")
    return int(cell)


def _number(cell: str) -> float:
    if cell.lower() in ("", "nan"):
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        raise ValueError("a number") from None
    if not math.isfinite(value):
        raise ValueError("a finite number")
    return value


def _lines(path: str) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells of every line that is not blank."""
    reader = None
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            for cells in reader:
                if cells:
                    yield reader.line_num, cells
    except OSError as error:
        raise DataError(Place(path, 1, 1, (error.strerror or str(error)).lower())) from None
    except UnicodeDecodeError:
        raise DataError(Place(path, 1, 1, "is not a text file in UTF-8")) from None
    except csv.Error as error:
        line = reader.line_num if reader is not None else 1
        raise DataError(Place(path, line, 1, f"not a CSV: {error}")) from None
