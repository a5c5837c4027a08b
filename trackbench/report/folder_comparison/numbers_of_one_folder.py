"""Filters, points of the grid and numbers that only one of two compared results folders has."""

from collections.abc import Iterator, Sequence
from math import isnan
from typing import Any, NamedTuple

from trackbench.evaluation.metric_expression import measured
from trackbench.report.findings.grid_headings import heading, join_heading
from trackbench.report.findings.phrases import listed, named, verb
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint

REMOVED = "removed"
ADDED = "added"


class OneSided(NamedTuple):
    """A point of the grid, a filter, or a filter's metrics, which one of two folders has alone."""

    verdict: str
    """`REMOVED` if the first folder has it alone, `ADDED` if the second does"""
    point: GridPoint | None
    """point of the grid; None if a filter, or metrics of it, stand alone at all common points"""
    filter: str | None = None
    """label; None for a point that stands alone for all filters"""
    metrics: tuple[str, ...] = ()
    """metrics of the filter, without their statistics; empty if the whole filter stands alone"""
    reason: str = ""
    """why the filter failed in the folder that lacks it; empty if it did not fail there"""

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Objects for programs: one for a point or filter, or one for each of a filter's metrics."""
        objects = []
        for metric in self.metrics or (None,):
            objects.append(
                {
                    "point": self.point,
                    "filter": self.filter,
                    "metric": metric,
                    "verdict": self.verdict,
                    "reason": self.reason,
                }
            )
        return objects

    def sentence(self, names: tuple[str, str]) -> str:
        """Return a sentence that names the folder which has it.

        ``names`` are those of the first and second folder.
        """
        with_it, without_it = names
        if self.verdict == ADDED:
            without_it, with_it = names
        place = heading(self.point) if self.point else ""
        if self.filter is None:
            return f"{place}: only in {with_it}."
        name = join_heading(named(self.filter), place)
        if self.metrics:
            return f"{name}: {listed(self.metrics)} {verb(self.metrics)} only in {with_it}."
        if self.reason:
            return f"{name}: only in {with_it}; it failed in {without_it}: {self.reason}"
        return f"{name}: only in {with_it}."


def filter_and_point(failure: dict[str, Any]) -> tuple[str, GridPoint]:
    """Return the label of a filter that failed, and the point of the grid where it did.

    ``failure`` is one of `Results.failed`: filter, reason, and the value of each of the grid's paths.
    """
    point = {key: value for key, value in failure.items() if key not in ("filter", "reason")}
    return failure["filter"], point


def numbers_of_one_folder(a: Results, b: Results) -> list[OneSided]:
    """List what only one of two results folders has: points first, then filters and their metrics."""
    return [*_numbers_missing(a, b, REMOVED), *_numbers_missing(b, a, ADDED)]


def _numbers_missing(results: Results, other: Results, verdict: str) -> Iterator[OneSided]:
    """Yield what ``results`` have and ``other`` lack, with this verdict."""
    common_points = []
    for point in results.points():
        if point in other.points():
            common_points.append(point)
        else:
            yield OneSided(verdict=verdict, point=point)
    failures = []
    for failure in other.failed:
        failures.append((*filter_and_point(failure), failure["reason"]))
    for label in results.filters:
        # What is missing at each common point: metrics, and why the filter failed if it did.
        missing = []
        for point in common_points:
            metrics = _measured_metrics(results, point, label)
            other_metrics = _measured_metrics(other, point, label)
            lacking = tuple(metric for metric in metrics if metric not in other_metrics)
            if not lacking:
                continue
            # Without a metric in the other folder, the whole filter is missing there.
            if not other_metrics:
                lacking = ()
            reasons = [why for name, place, why in failures if (name, place) == (label, point)]
            missing.append(OneSided(verdict, point, label, lacking, reasons[0] if reasons else ""))
        yield from _merged(missing, common_points)


def _merged(missing: Sequence[OneSided], points: Sequence[GridPoint]) -> Sequence[OneSided]:
    """Return one record for all points of the grid, if equal metrics are missing at each of them."""
    contents = {(item.metrics, item.reason) for item in missing}
    if len(missing) == len(points) and len(contents) == 1:
        return [missing[0]._replace(point=None)]
    return missing


def _measured_metrics(results: Results, point: GridPoint, label: str) -> list[str]:
    """Return the metrics with a number in summary.csv, each once and without its statistic."""
    rows = results.columns("summary", point).where(filter=label)
    metrics: dict[str, None] = {}
    for row in rows.records():
        if not isnan(row["value"]):
            metrics[measured(row["metric"]).name] = None
    return [*metrics]
