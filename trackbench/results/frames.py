"""CSV files of a results folder: data frames, columns as arrays, and the values of runs."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.yaml_source import unprintable_reason

if TYPE_CHECKING:
    import pandas as pd

Runs: TypeAlias = dict[tuple[str, str], Array]
"""Read-only values (M,) in the order of the runs, NaN where lost, by (filter, metric)."""

PointRuns: TypeAlias = dict[tuple[Any, ...], Runs]
Parse: TypeAlias = Callable[[str], Any]
"""Conversion of a column's texts to values."""

_ROWS_AT_A_TIME = 20_000
_TYPES: dict[str, type] = {
    **dict.fromkeys(["filter", "metric", "repeats", "likelihoods", "covariances"], str),
    **dict.fromkeys(["run", "step", "runs", "lost"], int),
    **dict.fromkeys(["time", "value", "stderr", "cpu_s", "cpu_s_per_run"], float),
}
"""Types of columns; those of a grid's columns follow from their texts."""


@dataclass(frozen=True)
class Columns:
    """Rows of a file: a read-only array per column, by its name."""

    arrays: dict[str, Array]

    @classmethod
    def of(cls, frame: "pd.DataFrame") -> "Columns":
        """Return the columns of a data frame; words are Python's strings."""
        arrays = {}
        for name in frame:
            is_number = frame[name].dtype.kind in "ifb"
            arrays[name] = fixed(frame[name].to_numpy(None if is_number else object))
        return cls(arrays)

    def __len__(self) -> int:
        return len(next(iter(self.arrays.values())))

    def __getitem__(self, name: str) -> Array:
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def where(self, **values: Any) -> "Columns":
        """Select the rows that have these values in these columns."""
        return self.at(values)

    def at(self, values: Mapping[str, Any]) -> "Columns":
        """Return the rows that have these values, by names of columns that may be no identifiers."""
        if not values:
            return self
        is_chosen = np.ones(len(self), dtype=np.bool_)
        for name, value in values.items():
            is_word = self[name].dtype == object
            is_equal = self._is_word(name, value) if is_word else self[name] == value
            is_chosen = np.logical_and(is_chosen, is_equal)
        return self.chosen(is_chosen)

    @cached_property
    def _codes(self) -> dict[str, tuple[Array, dict[object, int]]]:
        """Hold the numbers of words, and the words, of columns that were compared."""
        return {}

    def _is_word(self, name: str, value: object) -> Array:
        """Compare a column of words by their numbers, which takes a hundredth of the time."""
        import pandas as pd

        if name not in self._codes:
            codes, words = pd.factorize(self[name])
            self._codes[name] = (codes, {word: i for i, word in enumerate(words)})
        codes, numbers = self._codes[name]
        return np.asarray(codes == numbers.get(value, -2))

    def chosen(self, which: Any) -> "Columns":
        """Return rows by a mask or by their numbers."""
        return Columns({name: array[which] for name, array in self.arrays.items()})

    def tuples(self, names: Iterable[str]) -> Iterator[tuple[Any, ...]]:
        """Yield each row's values of these columns as Python's numbers and strings."""
        return zip(*(self[name].tolist() for name in names), strict=True)

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield each row's values by column."""
        return (dict(zip(self, row, strict=True)) for row in self.tuples(self))


def read_pieces(path: Path, needed: Collection[str]) -> Iterator["pd.DataFrame"]:
    """Yield the rows of a file, some thousands at a time; columns of a grid are words.

    Raises ValueError if a row has another length, a needed column is missing, or a word has control
    characters, some of which a terminal obeys.
    """
    import pandas as pd

    options: dict[str, Any] = {
        "dtype": defaultdict(lambda: str, _TYPES),
        "keep_default_na": False,  # a filter may be called nan
        "na_values": {name: ["nan"] for name, kind in _TYPES.items() if kind is float},
    }
    if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1):
        options["float_precision"] = "round_trip"  # else the last bit may be wrong
    with pd.read_csv(path, encoding="utf-8", chunksize=_ROWS_AT_A_TIME, **options) as pieces:
        for piece in pieces:
            missing = [name for name in needed if name not in piece]
            if missing:
                raise ValueError(f"has no column {missing[0]!r}")
            if not isinstance(piece.index, pd.RangeIndex):
                raise ValueError(f"has rows of more than {len(piece.columns)} cells")
            for name in piece:
                if _TYPES.get(name, str) is str:
                    _check_printable(piece[name].unique())
            yield piece


def _check_printable(texts: Iterable[str]) -> None:
    """Raise ValueError for a text with control characters."""
    for text in texts:
        reason = unprintable_reason(text)
        if reason:
            raise ValueError(reason)


def read_frame(path: Path, needed: Collection[str] = ()) -> "pd.DataFrame":
    """Read a file as a data frame; the types of a grid's columns follow from their texts."""
    import pandas as pd

    frame = pd.concat(read_pieces(path, needed), ignore_index=True)
    for name in set(frame) - _TYPES.keys():
        texts = frame[name].unique()
        parse = _choose_parse(texts)
        values = {text: parse(text) for text in texts}
        frame[name] = frame[name].map(values)
    return frame


def as_read(values: Sequence[Any]) -> list[Any]:
    """Return the values of a grid's column as they are read back from a file."""
    texts = ["" if value is None else str(value) for value in values]
    parse = _choose_parse(texts)
    return [parse(text) for text in texts]


def _choose_parse(texts: Collection[str]) -> Parse:
    """Find the first type that all texts have: whole numbers, numbers, truth values, words."""
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


def read_runs(path: Path, summary: Columns, grid: list[str], labels: Collection[str]) -> PointRuns:
    """Read the filters' runs by the values of the grid, which have their types in the summary."""
    keys = [*grid, "filter", "metric"]
    pieces: dict[tuple[str, ...], dict[tuple[str, str], list[Array]]] = {}
    for piece in read_pieces(path, ["filter", "metric", "value"]):
        of_filters = piece[piece["filter"].isin(labels)]
        if of_filters.empty:
            continue
        words = of_filters[keys].to_numpy(object)
        # A filter's values of a metric stand together.
        starts = np.flatnonzero((words[1:] != words[:-1]).any(axis=1)) + 1
        values = np.split(of_filters["value"].to_numpy(), starts)
        for (*texts, label, metric), run_values in zip(words[[0, *starts]], values, strict=True):
            of_point = pieces.setdefault(tuple(texts), {})
            of_point.setdefault((label, metric), []).append(run_values)
    parses = [_PARSES.get(summary[path].dtype.kind, str) for path in grid]
    point_runs: PointRuns = {}
    for texts, runs in pieces.items():
        point = tuple(parse(text) for parse, text in zip(parses, texts, strict=True))
        point_runs[point] = {key: fixed(np.concatenate(arrays)) for key, arrays in runs.items()}
    return point_runs
