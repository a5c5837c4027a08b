"""CSV files of a results folder as columns, without pandas, whose import takes a quarter of a second."""

import csv
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby, islice
from operator import itemgetter
from sys import intern
from typing import Any, TextIO, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, fixed

_ROWS_AT_A_TIME = 5000

Parse: TypeAlias = Callable[[str], Any]
"""Conversion of a column's texts to values."""


@dataclass(frozen=True)
class Columns:
    """Rows of a file: an array per column, by its name."""

    arrays: dict[str, Array]
    parses: dict[str, Parse]

    def __len__(self) -> int:
        return len(next(iter(self.arrays.values())))

    def __getitem__(self, name: str) -> Array:
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def where(self, **values: Any) -> "Columns":
        """Return the rows that have these values in these columns."""
        return self.at(values)

    def at(self, values: Mapping[str, Any]) -> "Columns":
        """Return the rows that have these values, by names of columns that may be no identifiers."""
        rows = self
        for name, value in values.items():
            rows = rows.chosen(rows[name] == value)
        return rows

    def chosen(self, which: Any) -> "Columns":
        """Return rows by a mask or by their numbers."""
        return Columns({name: array[which] for name, array in self.arrays.items()}, self.parses)

    def tuples(self, names: Iterable[str]) -> Iterator[tuple[Any, ...]]:
        """Yield each row's values of these columns as Python's numbers and strings."""
        return zip(*(self[name].tolist() for name in names), strict=True)

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield each row's values by column."""
        return (dict(zip(self, row, strict=True)) for row in self.tuples(self))


def read_columns(file: TextIO, needed: Collection[str] = ()) -> Columns:
    """Read a file's columns; the types of a grid's columns follow from their texts.

    The file is read in pieces: its texts take ten times the memory of its numbers. Raises ValueError if
    a row has another length, or a needed column is missing.
    """
    reader = csv.reader(file)
    head = next(reader, [])
    check_heads(head, needed)
    pieces: dict[str, list[Array]] = {name: [_array(_KNOWN.get(name, str), ())] for name in head}
    line = 2
    while rows := list(islice(reader, _ROWS_AT_A_TIME)):
        odd = next((n for n, row in enumerate(rows) if len(row) != len(head)), None)
        if odd is not None:
            cells = len(rows[odd])
            raise ValueError(f"line {line + odd} has {cells} cells under {len(head)} headings")
        line += len(rows)
        for name, texts in zip(head, zip(*rows, strict=True), strict=True):
            pieces[name].append(_array(_KNOWN.get(name, str), texts))
    parses, arrays = {}, {}
    for name in head:
        column = np.concatenate(pieces.pop(name))
        parses[name] = _KNOWN.get(name) or _parse_of(column)
        arrays[name] = fixed(column if name in _KNOWN else _array(parses[name], column.tolist()))
    return Columns(arrays, parses)


def check_heads(heads: Collection[str], needed: Collection[str]) -> None:
    """Raise ValueError if a needed column is missing."""
    missing = [name for name in needed if name not in heads]
    if missing:
        raise ValueError(f"has no column {missing[0]!r}")


def _truth(text: str) -> bool:
    return {"True": True, "False": False}[text]


def _parse_of(texts: Iterable[str]) -> Parse:
    """Return the first type that all texts have: whole numbers, numbers, truth values, words."""
    distinct = set(texts)
    for parse in (int, float, _truth):
        with suppress(ValueError, KeyError):
            for text in distinct:
                parse(text)
            return parse
    return str


def _array(parse: Parse, texts: Sequence[str]) -> Array:
    if parse is str:  # equal words become one object
        return np.array([intern(text) for text in texts], dtype=object)
    values = [parse(text) for text in texts]
    return np.array(values, dtype=None if values else float if parse is float else int)


_KNOWN: dict[str, Parse] = {
    **dict.fromkeys(["filter", "metric", "repeats", "likelihoods", "covariances"], str),
    **dict.fromkeys(["run", "step", "runs", "lost"], int),
    **dict.fromkeys(["time", "value", "stderr", "cpu_s", "cpu_s_per_run"], float),
}

Runs: TypeAlias = dict[tuple[str, str], Array]
"""Read-only values (M,) in the order of the runs, NaN where lost, by (filter, metric)."""


def read_runs(
    file: TextIO, grid: Mapping[str, Parse], labels: Collection[str]
) -> dict[tuple[Any, ...], Runs]:
    """Return the filters' runs by the values of the grid's columns, which ``grid`` converts."""
    rows = csv.reader(file)
    head = next(rows, [])
    check_heads(head, ["filter", "metric", "value"])
    value = itemgetter(head.index("value"))
    pieces: dict[tuple[Any, ...], dict[tuple[str, str], list[Array]]] = {}
    keys = itemgetter(*(head.index(name) for name in (*grid, "filter", "metric")))
    for (*texts, label, metric), group in groupby(rows, keys):
        if label in labels:
            point = tuple(parse(text) for parse, text in zip(grid.values(), texts, strict=True))
            values = np.fromiter(map(float, map(value, group)), float)
            pieces.setdefault(point, {}).setdefault((label, metric), []).append(values)
    return {
        point: {key: fixed(np.concatenate(parts)) for key, parts in runs.items()}
        for point, runs in pieces.items()
    }
