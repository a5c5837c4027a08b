"""The files of a results folder as columns, data frames and arrays.

CSV files are read without pandas, whose import takes a quarter of a second.
"""

import csv
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, islice
from operator import itemgetter
from pathlib import Path
from sys import intern
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TextIO, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.errors import UserError
from trackbench.plugins.errors import message_of
from trackbench.report.requested import ResultsConfig
from trackbench.results.folder_contents import COLUMNS, DATA_FILES, TIMING, read_manifest
from trackbench.results.point_facts import (
    POINTS_FILE,
    GridPoint,
    PointFacts,
    array_prefix,
    points_in,
)
from trackbench.yaml_source import unprintable_reason

if TYPE_CHECKING:
    import pandas as pd


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


def _check_printable(texts: Iterable[str]) -> None:
    """Raise ValueError for a word with control characters, some of which a terminal obeys."""
    for text in texts:
        if what := unprintable_reason(text):
            raise ValueError(what)


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
        _check_printable(set(texts))
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
            _check_printable([metric])
            point = tuple(parse(text) for parse, text in zip(grid.values(), texts, strict=True))
            values = np.fromiter(map(float, map(value, group)), float)
            pieces.setdefault(point, {}).setdefault((label, metric), []).append(values)
    return {
        point: {key: fixed(np.concatenate(parts)) for key, parts in runs.items()}
        for point, runs in pieces.items()
    }


RUN_AGAIN = "run the experiment again"


@dataclass(frozen=True, repr=False)
class ResultFiles(ResultsConfig):
    """The files of one results folder, each read at its first use."""

    run_facts: dict[str, Any] | None = None
    """content of the manifest, until it is written"""
    point_facts: tuple[PointFacts, ...] | None = None
    """facts about the points, instead of those in the folder"""

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Facts of the experiment and of its run: steps, failures, versions, times."""
        if self.run_facts is not None:
            return self.run_facts
        with self.reading("manifest.json"):
            return read_manifest(self.folder)

    @property
    def deterministic(self) -> list[str]:
        """Return labels of the filters whose numbers hold no randomness: no draws, recorded data."""
        return self.manifest.get("deterministic", [])

    @property
    def loops_over_runs(self) -> list[str]:
        """Labels of the filters that take one run after the other in Python, and so more time."""
        return self.manifest.get("loops_over_runs", [])

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Return filters that raised: ``filter``, ``reason`` and the grid point's values."""
        return self.manifest["failed"]

    def facts(self, point: GridPoint) -> PointFacts:
        """Return the facts about a point beside numbers: scenario, filters, components, shading."""
        facts = next((f for f in self._facts if same_point(f.values, point)), None)
        if facts is None:
            raise UserError(f"{self.folder / POINTS_FILE}: {point} is not in it: {RUN_AGAIN}")
        return facts

    @cached_property
    def _facts(self) -> tuple[PointFacts, ...]:
        if self.point_facts is not None:
            return self.point_facts
        with self.reading(POINTS_FILE) as path:
            return tuple(points_in(path.read_text(encoding="utf-8")))

    @cached_property
    def per_run(self) -> "pd.DataFrame":
        """Return per_run.csv, ``filter,run,metric,value``; tables and figures use `runs`."""
        return self._frame("per_run.csv")

    @cached_property
    def per_step(self) -> "pd.DataFrame":
        """Return per_step.csv, ``filter,step,time,metric,value,stderr,runs``."""
        return self._frame("per_step.csv")

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """Return summary.csv, ``filter,metric,value,stderr,runs,lost``."""
        return self._frame("summary.csv")

    @cached_property
    def timing(self) -> "pd.DataFrame":
        """Return timing.csv, ``filter,runs,cpu_s,cpu_s_per_run,stderr,repeats,...``."""
        return self._frame("timing.csv")

    @cached_property
    def shown(self) -> dict[str, Array]:
        """Return the arrays of shown.npz at all points; empty if every filter failed."""
        return self.arrays("shown.npz")

    def arrays(self, name: str) -> dict[str, Array]:
        """Return the arrays of a file; empty if there is no such file."""
        if not (self.folder / name).is_file():
            return {}
        with self.reading(name) as path, path.open("rb") as file, np.load(file) as arrays:
            return dict(arrays)

    @cached_property
    def saved(self) -> dict[str, Array]:
        """Return the arrays of tracks.npz, every run's, at all points; empty if none were saved."""
        return self.arrays("tracks.npz")

    def tracks(self, point: GridPoint, every_run: bool = False) -> dict[str, Array]:
        """Return tracks of the first runs: ``truth``, ``measurements``, ``mean/<filter>``, ``steps``.

        With ``every_run`` they are all runs' if these were saved. Empty if every filter failed at the
        point.
        """
        i = self.index_of(point)
        prefix = array_prefix(i or 0, len(self.grid_points))
        return {
            name.removeprefix(prefix): array
            for name, array in ((self.saved if every_run else {}) or self.shown).items()
            if i is not None and name.startswith(prefix)
        }

    def steps(self, point: GridPoint) -> int:
        """Return the number of steps of a run at a point."""
        steps, i = self.manifest.get("steps"), self.index_of(point) or 0
        number = steps[i] if isinstance(steps, list) and i < len(steps) else steps
        if not isinstance(number, int) or number < 1:
            what = "does not say how many steps a run has"
            raise UserError(f"{self.folder / 'manifest.json'}: {what}: {RUN_AGAIN}")
        return number

    def runs(self, point: GridPoint) -> Runs:
        """Return the values per run at a point; empty if every filter failed there."""
        return self._runs.get(tuple(point.values()), {})

    @cached_property
    def _runs(self) -> dict[tuple[Any, ...], Runs]:
        parses = self.columns("summary").parses
        with self.open_csv("per_run.csv") as file:
            return read_runs(file, {path: parses[path] for path in self.grid}, self.filters)

    @contextmanager
    def open_csv(self, name: str) -> Iterator[TextIO]:
        """Open one of the CSV files as text; raises UserError if it cannot be read."""
        with self.reading(name) as path, path.open(encoding="utf-8", newline="") as file:
            yield file

    @contextmanager
    def reading(self, name: str) -> Iterator[Path]:
        """Give a file's path; turn any error over its content into one line."""
        path = self.folder / name
        if name == "timing.csv" and not path.is_file():  # where older versions wrote it
            path = self.folder / TIMING
        if not path.is_file():
            why = " (git keeps its digest alone)" if name in DATA_FILES else ""
            raise UserError(f"{path}: is missing{why}: {RUN_AGAIN}")
        try:
            yield path
        except Exception as error:
            raise UserError(f"{path}: cannot be read, {message_of(error)}: {RUN_AGAIN}") from error

    def points(self) -> list[dict[str, Any]]:
        """Return the points that have results, in order; one empty point without a grid."""
        summary = self.columns("summary")
        if not self.grid or not len(summary):  # every filter failed
            return self.grid_points
        rows = dict.fromkeys(summary.tuples(self.grid))
        return [dict(zip(self.grid, row, strict=True)) for row in rows]

    def index_of(self, point: GridPoint) -> int | None:
        """Return a point's number in the config's grid; None if the grid does not have it."""
        return next(
            (i for i, given in enumerate(self.grid_points) if same_point(given, point)), None
        )

    def columns(self, name: str, point: Mapping[str, Any] = MappingProxyType({})) -> Columns:
        """Return rows of `summary`, `per_step` or `timing`, at one grid point or at all."""
        if name not in self._columns:
            with self.open_csv(f"{name}.csv") as file:
                self._columns[name] = read_columns(file, COLUMNS[f"{name}.csv"])
        return self._columns[name].at(point)

    @cached_property
    def _columns(self) -> dict[str, Columns]:
        return {}

    def at(self, frame: "pd.DataFrame", point: GridPoint) -> "pd.DataFrame":
        """Return the rows of one grid point."""
        for path, value in point.items():
            frame = frame[frame[path] == value]
        return frame

    def _frame(self, name: str) -> "pd.DataFrame":
        import pandas as pd

        missing = {key: ["nan"] for key in _NUMBERS}  # no others: a filter may be called nan
        with self.reading(name) as path:
            frame = pd.read_csv(path, dtype=_TYPES, keep_default_na=False, na_values=missing)
            check_heads(frame.columns, COLUMNS[name])
            return frame


def same_point(point: GridPoint, read_back: dict[str, Any]) -> bool:
    """Return whether a point of the config is one of a CSV file, where null and lists are texts."""
    pairs = ((value, read_back[path]) for path, value in point.items())
    return all(a == b or ("" if a is None else str(a)) == str(b) for a, b in pairs)


_NUMBERS = ("time", "value", "stderr", "cpu_s", "cpu_s_per_run")
_TYPES: Any = {
    "filter": str,
    **dict.fromkeys(["run", "step", "runs", "lost"], int),
    **dict.fromkeys(_NUMBERS, float),
}
"""Types of columns, also of a file without rows, where every filter failed."""
