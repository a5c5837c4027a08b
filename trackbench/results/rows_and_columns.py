"""Rows of a results file as columns: select the rows with given values; numbers per run as rows."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed

Runs: TypeAlias = dict[tuple[str, str], Array]
"""Read-only values (M,) in the order of the runs, NaN where lost, by (filter, metric)."""
PointRuns: TypeAlias = dict[tuple[Any, ...], Runs]
"""Values per run at each point of the grid, by the values of the grid's paths."""
_NUMBERS = ("run", "step", "time", "value", "stderr", "runs")


@dataclass(frozen=True)
class Columns:
    """Rows of a file: a read-only array per column, by its name."""

    arrays: dict[str, Array]

    def __len__(self) -> int:
        return len(next(iter(self.arrays.values())))

    def __getitem__(self, name: str) -> Array:
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def where(self, **values: Any) -> "Columns":
        """Select the rows that have these values in these columns."""
        return self.rows_with(values)

    def rows_with(self, values: Mapping[str, Any]) -> "Columns":
        """Return the rows that have these values in these columns.

        Unlike in `where`, a column's name need not be an identifier of Python.
        """
        if not values:
            return self
        is_chosen = np.ones(len(self), dtype=np.bool_)
        for name, value in values.items():
            is_word = self[name].dtype == object  # texts, such as labels of filters
            has_value = self._rows_with_word(name, value) if is_word else self[name] == value
            is_chosen = np.logical_and(is_chosen, has_value)
        return self.chosen(is_chosen)

    @cached_property
    def _codes(self) -> dict[str, tuple[Array, dict[object, int]]]:
        """Codes of each compared column of words: the rows' codes, and the code of each word.

        `_rows_with_word` fills the mapping.
        """
        return {}

    def _rows_with_word(self, name: str, value: object) -> Array:
        """Return a mask (R,) of the rows that have the word ``value`` in the column ``name``.

        Words are compared by codes, which are whole numbers: that takes a hundredth of the time.
        """
        if name not in self._codes:
            new_codes: dict[object, int] = {}
            words = self[name].tolist()
            row_codes = [new_codes.setdefault(word, len(new_codes)) for word in words]
            self._codes[name] = (np.array(row_codes, dtype=np.int64), new_codes)
        codes_of_rows, code_by_word = self._codes[name]
        # No row has the code -1.
        return np.asarray(codes_of_rows == code_by_word.get(value, -1))

    def chosen(self, which: Any) -> "Columns":
        """Return the rows that a mask (R,) marks, or those with the given indices."""
        return Columns({name: array[which] for name, array in self.arrays.items()})

    def tuples(self, names: Iterable[str]) -> Iterator[tuple[Any, ...]]:
        """Yield each row's values of these columns as Python's numbers and strings."""
        return zip(*(self[name].tolist() for name in names), strict=True)

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield each row's values by column."""
        return (dict(zip(self, row, strict=True)) for row in self.tuples(self))


class Series(NamedTuple):
    """Rows of one metric of one filter at one grid point."""

    constants: dict[str, Any]
    """the one value of each column of the grid, of ``filter`` and of ``metric``"""
    numbers: dict[str, Any]
    """columns (S,) such as ``step``, ``time``, ``value``, ``stderr`` and ``runs``"""

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.numbers["value"])


class SeriesColumns(Columns):
    """Rows of arrays as those of a CSV file; only the series that are chosen are joined."""

    def __init__(self, series: Sequence[Series], names: Sequence[str]) -> None:
        """Begin with the rows of all ``series``; ``names`` are those of the columns, in order."""
        # `Columns` is a frozen dataclass, which takes no assignments.
        object.__setattr__(self, "_series", tuple(series))
        object.__setattr__(self, "_names", tuple(names))

    _series: tuple[Series, ...]
    _names: tuple[str, ...]

    @cached_property
    def arrays(self) -> dict[str, Array]:
        """All rows: a read-only array per column, by its name."""
        arrays: dict[str, Array] = {}
        for name in self._names:
            parts = [_column(series, name) for series in self._series]
            arrays[name] = fixed(np.concatenate(parts) if parts else np.empty(0))
        return arrays

    def rows_with(self, values: Mapping[str, Any]) -> Columns:
        """Return the rows that have the given ``values``, by the names of their columns."""
        # Constants, such as the filter's label, choose whole series; numbers choose rows of them.
        constant_columns = set(self._names).difference(_NUMBERS)
        constants = {name: value for name, value in values.items() if name in constant_columns}
        chosen = [
            series
            for series in self._series
            if all(series.constants[name] == value for name, value in constants.items())
        ]
        columns = SeriesColumns(chosen, self._names)
        numbers = {name: value for name, value in values.items() if name not in constant_columns}
        if not numbers:
            return columns
        return Columns(columns.arrays).rows_with(numbers)


def _column(series: Series, name: str) -> Array:
    """Return one column (S,) of a series' rows."""
    if name in series.numbers:
        return series.numbers[name]
    # A text, such as the filter's label, or a number or truth value of the grid.
    value = series.constants[name]
    if isinstance(value, str):
        return np.full(series.rows, value, dtype=object)
    return np.full(series.rows, value)


def rows_of_runs(runs: PointRuns, columns: Sequence[str]) -> Columns:
    """Return the values per run at each point as the rows of per_run.csv.

    ``columns`` are the names of that file's columns, the grid's paths first.
    """
    paths = [name for name in columns if name not in ("filter", "run", "metric", "value")]
    series = []
    for values_of_point, runs_of_point in runs.items():
        point = dict(zip(paths, values_of_point, strict=True))
        for (label, metric), values in runs_of_point.items():
            constants = {**point, "filter": label, "metric": metric}
            numbers = {"run": np.arange(len(values)), "value": values}
            series.append(Series(constants=constants, numbers=numbers))
    return SeriesColumns(series, columns)
