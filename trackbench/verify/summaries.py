"""summary.csv held against per_run.csv, from which most of it follows."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.consistency import sizes
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.summary import SummaryRow, summary_rows
from trackbench.report.results import Results
from trackbench.results.write import DIGITS
from trackbench.scenarios.base import Scenario
from trackbench.verify.findings import Finding, changed

HALF = {name: 0.5 * 10.0 ** (1 - digits) for name, digits in DIGITS.items()}
"""Share of a stored number that its digits leave open, at most."""
_MARGIN = 2.0  # the ways that rounding is tried below are not all there are
_FEW = 6
"""Runs, or different values, that are moved one by one: few may be rounded in none of those ways."""


class Column:
    """The rows of a metric as they follow from its rounded values (M,), and their room by that."""

    def __init__(self, x: Array, make: Callable[[Array], list[SummaryRow]]) -> None:
        self._x, self._make = x, make
        self.rows = make(x)

    @cached_property
    @np.errstate(all="ignore")
    def rooms(self) -> list[list[float]]:
        """How far value and error of each row may be off by how the values were rounded.

        All of them up, apart or askew, and back; or, of a few different ones, each as it makes things
        worse.
        """
        x = self._x
        half = HALF["per_run.csv"] * np.where(np.isfinite(x), np.abs(x), 0.0)
        sides = (1.0, _apart(x), _apart(x, 3))
        together = [self._off(x + sign * half * side) for side in sides for sign in (1.0, -1.0)]
        nothing = np.zeros((len(self.rows), 2))
        each = sum((self._off(x + half * part) for part in _parts(x)), nothing)
        rooms: list[list[float]] = (_MARGIN * np.max([*together, each], axis=0)).tolist()
        return rooms

    def _off(self, values: Array) -> Array:
        """What becomes of value and error of the rows (rows, 2); not a number where they are none."""
        return np.abs(_numbers(self._make(values)) - _numbers(self.rows))


class Bounded(NamedTuple):
    """A row as it follows from rounded values, and how far value and error may be off by that."""

    row: SummaryRow
    column: Column
    place: int

    def holds(self, stored: SummaryRow) -> bool:
        """Whether a stored row, rounded itself, may be this one; the room is found if it is needed."""
        if (stored.runs, stored.lost) != (self.row.runs, self.row.lost):
            return False
        return self._is(stored, (0.0, 0.0)) or self._is(stored, self.column.rooms[self.place])

    def _is(self, stored: SummaryRow, room: Sequence[float]) -> bool:
        return near(stored.value, self.row.value, room[0]) and near(
            stored.stderr, self.row.stderr, room[1]
        )


def near(stored: float, found: float, room: float, file: str = "summary.csv") -> bool:
    """Whether a stored number is one that was found, but for so much and its own digits."""
    if np.isnan(stored) or np.isnan(found) or np.isinf(found):
        return bool(np.array_equal(stored, found, equal_nan=True))
    return abs(stored - found) <= room + 1.01 * HALF[file] * max(abs(stored), abs(found))


def follow_from_runs(
    results: Results, points: list[tuple[dict[str, Any], Point]]
) -> Iterator[Finding]:
    """Rows of summary.csv that do not follow from the stored runs, or that nothing gives.

    ``points`` are those that have results, as they are read and as they are run.
    """
    wrong, number = [], 0
    for point, run in points:
        stored = stored_rows(results, point)
        found = _found(results, point, run.scenario)
        mine = {
            key: row
            for key, row in stored.items()
            if key[0] != results.config["bound"]
            and (key in found or not key[1].startswith("time-mean("))
        }
        number += len(mine)
        for key in dict.fromkeys([*found, *mine]):
            if key not in mine or key not in found or not found[key].holds(mine[key]):
                wrong.append((*point.values(), *key))
        if {len(values) for values in results.runs(point).values()} - {results.config["runs"]}:
            what = "has not as many runs of every metric as the config asks for"
            yield changed(f"per_run.csv: {what}")
    if wrong:
        first = ", ".join(map(str, wrong[0]))
        what = "do not follow from per_run.csv; the first is that of"
        yield changed(f"summary.csv: {len(wrong)} of {number} rows {what} {first}")


def stored_rows(results: Results, point: dict[str, Any]) -> dict[tuple[str, str], SummaryRow]:
    """Rows of summary.csv at a point by (filter, metric)."""
    frame = results.at(results.summary, point)[["filter", *SummaryRow._fields]]
    rows = frame.itertuples(index=False, name=None)
    return {(label, row[0]): SummaryRow(*row) for label, *row in rows}


def _found(
    results: Results, point: dict[str, Any], scenario: Scenario
) -> dict[tuple[str, str], Bounded]:
    runs, found = results.runs(point), {}
    for label in dict.fromkeys(label for label, _ in runs):
        mine = {metric: values for (of, metric), values in runs.items() if of == label}
        for row in bounded(mine, sizes(scenario)):
            found[label, row.row.metric] = row
    return found


def bounded(runs: dict[str, Array], sizes: Mapping[str, int]) -> Iterator[Bounded]:
    """The rows of one filter, with their room; ``sizes`` are as `summary_rows` takes them."""
    for name, x in runs.items():
        if name != "lost":
            column = Column(x, partial(_rows, name, lost=runs["lost"], sizes=sizes))
            for place, row in enumerate(column.rows):
                yield Bounded(row, column, place)


@np.errstate(all="ignore")
def _rows(name: str, x: Array, lost: Array, sizes: Mapping[str, int]) -> list[SummaryRow]:
    return list(summary_rows(FilterResult({"lost": lost, name: x}, {}, {}, None, []), sizes, {}))


def _numbers(rows: list[SummaryRow]) -> Array:
    return np.array([[row.value, row.stderr] for row in rows]).reshape(-1, 2)


def _parts(x: Array) -> Iterable[Array]:
    """Each run of few, or those of each value of few; none of many."""
    if len(x) <= _FEW:
        return np.eye(len(x))
    values = np.unique(x[np.isfinite(x)])
    return [x == value for value in values] if len(values) <= _FEW else []


def _apart(x: Array, part: int = 2) -> Array:
    """The larger up and the smaller half down; of two halves a variance has no error, but of a third."""
    side = np.ones(len(x))
    side[np.argsort(x)[: np.isfinite(x).sum() // part]] = -1.0
    return side
