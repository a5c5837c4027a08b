"""Read the CSV files of a results folder: columns as arrays, and the values of runs."""

import csv
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import groupby, islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.results.rows_and_columns import Columns, PointRuns
from trackbench.unsafe_characters import unprintable_reason

Parse: TypeAlias = Callable[[str], Any]
"""Conversion of a column's texts to values."""

_ROWS_AT_A_TIME = 5_000
_TYPES: dict[str, type] = {
    **dict.fromkeys(["filter", "metric", "repeats", "likelihoods", "covariances"], str),
    **dict.fromkeys(["run", "step", "runs", "lost"], int),
    **dict.fromkeys(["time", "value", "stderr", "cpu_s", "cpu_s_per_run"], float),
}
"""Types of columns; those of a grid's columns follow from their texts."""


def read_pieces(
    path: Path, needed: Collection[str], only: Collection[str] | None = None
) -> Iterator[Columns]:
    """Yield the rows of a file, some thousands at a time.

    Columns that `_TYPES` does not name, those of a grid, stay texts: only all rows show their type. The
    library csv reads the file: pandas takes as long to import as a small experiment to run.

    Parameters
    ----------
    path
        File to read.
    needed
        Names of columns that the file must have.
    only
        Names of the columns to read. Default: all.

    Raises
    ------
    ValueError
        If a row has another length, a cell is no number, a needed column is missing, or a word has
        control characters, some of which a terminal obeys.
    """
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file, strict=True)
        header = next(reader, [])
        for name in needed:
            if name not in header:
                raise ValueError(f"has no column {name!r}")
        if not header:
            raise ValueError("is empty")
        while True:
            rows = list(islice(reader, _ROWS_AT_A_TIME))
            for row in rows:
                if len(row) != len(header):
                    raise ValueError(f"has a row of {len(row)} cells in place of {len(header)}")
            arrays = {}
            for j, name in enumerate(header):
                if only is not None and name not in only:
                    continue
                texts = [row[j] for row in rows]
                arrays[name] = _as_array(texts, _TYPES.get(name, str))
            yield Columns(arrays)
            if len(rows) < _ROWS_AT_A_TIME:  # the file has no more
                return


def _as_array(texts: Sequence[str], kind: type) -> Array:
    """Convert a column's texts to an array (R,) of the type ``kind``: int, float or str.

    Equal words are one string in memory. Raises ValueError for a text that is no such value.
    """
    if kind is int:
        return np.fromiter(map(int, texts), dtype=np.int64, count=len(texts))
    if kind is float:
        return np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    _check_printable(set(texts))
    return np.fromiter(map(sys.intern, texts), dtype=object, count=len(texts))


def _check_printable(texts: Iterable[str]) -> None:
    """Raise ValueError for a text with control characters."""
    for text in texts:
        reason = unprintable_reason(text)
        if reason:
            raise ValueError(reason)


def read_columns(path: Path, needed: Collection[str] = ()) -> Columns:
    """Read a whole file with the columns ``needed``, and perhaps others.

    The types of a grid's columns follow from their texts.
    """
    pieces = [*read_pieces(path, needed=needed)]
    arrays = {}
    for name in pieces[0]:
        array = np.concatenate([piece[name] for piece in pieces])
        if name not in _TYPES:
            texts = set(array.tolist())
            parse = _choose_parse(texts)
            values = {text: parse(text) for text in texts}
            column = [values[text] for text in array.tolist()]
            array = np.array(column, dtype=object if parse is str else None)
        arrays[name] = fixed(array)
    return Columns(arrays)


def _choose_parse(texts: Collection[str]) -> Parse:
    """Choose how to convert a column's texts: as whole numbers, else numbers, truth values or words.

    It is the first conversion that all texts allow.
    """
    for parse in (int, float, _parse_truth):
        with suppress(ValueError, KeyError):
            for text in texts:
                parse(text)
            return parse
    return str


def _parse_truth(text: str) -> bool:
    return {"True": True, "False": False}[text]


_PARSES: dict[str, Parse] = {"i": int, "f": float, "b": _parse_truth}
"""Conversion of texts to the values of a column, by its type in numpy."""


def parse_of(column: Array) -> Parse:
    """Return the conversion of texts to the values of a grid's column that was read from a file."""
    return _PARSES.get(column.dtype.kind, str)


def read_runs(path: Path, summary: Columns, grid: list[str], labels: Collection[str]) -> PointRuns:
    """Read per_run.csv: read-only values (M,) by filter and metric, at each point of the grid.

    ``grid`` are the grid's paths; their values get the types that they have in the columns of
    ``summary``, which are those of summary.csv. ``labels`` are the filters to read.
    """
    keys = [*grid, "filter", "metric"]
    # By the texts of a point, then by filter and metric: the values in pieces of the file.
    pieces: dict[tuple[str, ...], dict[tuple[str, str], list[Array]]] = {}
    for piece in read_pieces(path, needed=["filter", "metric", "value"], only=[*keys, "value"]):
        # A filter's values of a metric stand together.
        end = 0
        for words, rows in groupby(piece.tuples(keys)):
            start = end
            end += sum(1 for _ in rows)
            *texts, label, metric = words
            if label in labels:
                pieces_of_point = pieces.setdefault(tuple(texts), {})
                values = piece["value"][start:end]
                pieces_of_point.setdefault((label, metric), []).append(values)
    parses = [parse_of(summary[path]) for path in grid]
    point_runs: PointRuns = {}
    for point_texts, runs in pieces.items():
        point = tuple(parse(text) for parse, text in zip(parses, point_texts, strict=True))
        point_runs[point] = {key: fixed(np.concatenate(arrays)) for key, arrays in runs.items()}
    return point_runs
