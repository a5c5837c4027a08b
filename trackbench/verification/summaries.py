"""summary.csv held against per_run.csv, from which most of it follows."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.derived import sizes
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.summary import SummaryRow, summary_rows
from trackbench.experiment.reading.definition import Point
from trackbench.experiment.storing.store import DIGITS
from trackbench.report.results import Results
from trackbench.scenarios.base import Scenario
from trackbench.verification.findings import Finding, changed

HALF = {name: 0.5 * 10.0 ** (1 - digits) for name, digits in DIGITS.items()}
"""Share of a stored number that its digits leave open, at most."""
_MARGIN = 2.0  # the ways that rounding is tried below are not all there are
_FEW = 6
"""Runs, or different values, that are moved one by one: few may be rounded in none of those ways."""


class Bounded(NamedTuple):
    """A row as it follows from rounded values, and how far value and error may be off by that."""

    row: SummaryRow
    value_room: float
    stderr_room: float

    def holds(self, stored: SummaryRow) -> bool:
        """Whether a stored row, rounded itself, may be this one."""
        return (
            (stored.runs, stored.lost) == (self.row.runs, self.row.lost)
            and near(stored.value, self.row.value, self.value_room)
            and near(stored.stderr, self.row.stderr, self.stderr_room)
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
    timing = results.timing
    if not np.allclose(timing["cpu_s_per_run"], timing["cpu_s"] / timing["runs"], 1e-9, 0.0):
        yield changed("timing.csv: cpu_s_per_run is not cpu_s over runs")
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


@np.errstate(all="ignore")
def bounded(runs: dict[str, Array], sizes: Mapping[str, int]) -> list[Bounded]:
    """The rows of one filter; their room from moving the values to where they may have been.

    ``sizes`` are as `summary_rows` takes them.
    """
    columns = (
        _of_column(x, partial(_rows, name, lost=runs["lost"], sizes=sizes))
        for name, x in runs.items()
        if name != "lost"
    )
    return [row for column in columns for row in column]


def _rows(name: str, x: Array, lost: Array, sizes: Mapping[str, int]) -> list[SummaryRow]:
    return list(summary_rows(FilterResult({"lost": lost, name: x}, {}, {}, None, []), sizes, {}))


def _of_column(x: Array, make: Callable[[Array], list[SummaryRow]]) -> Iterator[Bounded]:
    """The rows of a metric, and how far they may be off by how its values (M,) were rounded.

    All of them up, apart or askew, and back; or, of a few different ones, each as it makes things worse.
    """

    def off(values: Array) -> Array:  # (rows, 2); not a number where they are none
        return np.abs(_numbers(make(values)) - _numbers(found))

    found, half = make(x), HALF["per_run.csv"] * np.where(np.isfinite(x), np.abs(x), 0.0)
    sides = (1.0, _apart(x), _apart(x, 3))
    together = [off(x + sign * half * side) for side in sides for sign in (1.0, -1.0)]
    each = sum((off(x + half * part) for part in _parts(x)), np.zeros((len(found), 2)))
    rooms = _MARGIN * np.max([*together, each], axis=0)
    return (Bounded(row, *room) for row, room in zip(found, rooms.tolist(), strict=True))


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
