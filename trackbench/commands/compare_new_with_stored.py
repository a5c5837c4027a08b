"""Comparison of new results with stored ones, for a gate: verdicts, new failures, removals, costs."""

from collections.abc import Iterator, Sequence
from math import isnan, nan
from typing import Any, NamedTuple

from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measured
from trackbench.report.cost_curves import COST
from trackbench.report.findings.grid_headings import heading
from trackbench.report.findings.phrases import named
from trackbench.report.folder_comparison.numbers_and_pairing import compare_folders
from trackbench.report.folder_comparison.numbers_of_one_folder import filter_and_point
from trackbench.report.folder_comparison.tests_and_verdicts import Row, is_event
from trackbench.report.primary_metrics import errors_and_scores
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import TIMING
from trackbench.results.points_json import GridPoint
from trackbench.statistics.comparison import compare_independent
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.holm_correction import signs_beyond
from trackbench.statistics.significance_rules import ALIKE, BETTER, EQUAL, UNTESTED, WORSE

NEGLIGIBLE = "negligible"
FAILED = "failed"


class Limit(NamedTuple):
    """Family-wise false alarm rate as standard deviations, and the share of a value that matters."""

    sigmas: float
    share: float


class Removed(NamedTuple):
    """A grid point, a filter, or a filter's metric that stored results have and the new ones lack."""

    point: GridPoint | None = None
    """point of the grid; it is gone for all filters, so ``filter`` and ``metric`` are None"""
    filter: str | None = None
    metric: str | None = None
    """error or score of the filter; None if the whole filter is gone"""

    def __str__(self) -> str:
        """Name what the new results lack: a point alone, a whole filter, or a metric of a filter."""
        if self.point is not None:
            return heading(self.point)
        assert self.filter is not None
        if self.metric is None:
            return named(self.filter)
        return f"{self.metric} of {named(self.filter)}"


class Failure(NamedTuple):
    """Filter that fails, and did not fail before."""

    filter: str
    reason: str

    def __str__(self) -> str:
        return f"{self.filter} failed: {self.reason}"


class Verdict(NamedTuple):
    """Result of a gate: its tests, and what could not be compared."""

    name: str
    rows: list[Row]
    failed: list[Failure]
    removed: list[Removed]
    """filters, points of the grid and numbers that were there before, and are not allowed to go"""
    notes: list[str]

    @property
    def is_worse(self) -> bool:
        """True if a number is worse beyond the limit, a filter begins to fail, or something is gone."""
        is_any_worse = any(row.verdict == WORSE for row in self.rows)
        return bool(self.failed) or bool(self.removed) or is_any_worse

    @property
    def compared(self) -> list[str]:
        """Labels of the filters that both sides have."""
        return [*dict.fromkeys(row.filter for row in self.rows)]


def compare_results(stored: Results, new: Results, limit: Limit, largest_ratio: float) -> Verdict:
    """Judge the primary metrics of the filters that both results have.

    These are errors, scores, shares of runs and the ANEES, each over whole runs. The verdict also lists
    the filters that failed and what the new results lack. ``limit`` has the rate of false alarms of the
    tests, and the share of a value that a difference must exceed. ``largest_ratio`` is the largest ratio
    of costs that is accepted; 0 compares no costs.
    """
    # Step 1: the tests of filters that both have. A row compares a metric of a filter at a grid point.
    all_rows, why_not_paired = compare_folders(stored, new)
    rows = judge([row for row in all_rows if row.is_primary], limit)
    # Step 2: filters that fail now, and filters and numbers that are gone.
    labels_with_rows = set(stored.columns("summary")["filter"].tolist())
    stored_labels = [label for label in stored.filters if label in labels_with_rows]
    # A filter of the stored config without numbers failed there.
    failed_before = set(stored.config["filters"]) - set(stored_labels)
    # Filters that failed there at some points of the grid, and have numbers at others.
    failures_before = [filter_and_point(row) for row in stored.failed]
    failed = []
    for failure in new.failed:
        is_new_failure = filter_and_point(failure) not in failures_before
        if is_new_failure and failure["filter"] not in failed_before:
            failed.append(Failure(filter=failure["filter"], reason=failure["reason"]))
    # A filter that loses every run has no errors to test, and there may be too few runs to test their
    # share. So it counts as failed if it did not lose every run before.
    for label, point in _losing_every_run(new):
        if label in stored_labels and (label, point) not in _losing_every_run(stored):
            words = ", ".join(filter(None, ["every run is lost", heading(point)]))
            failed.append(Failure(filter=label, reason=words))
    removed = list(_find_removed(stored, new, stored_labels))
    if not rows and not failed and not removed:
        raise UserError("nothing to compare: no filter has an error or score on both sides")
    # Step 3: costs, and notes on what is not compared.
    rows += _compare_costs(stored, new, largest_ratio)
    notes = []
    if why_not_paired:
        notes.append(f"not paired: {why_not_paired}")
    for label in new.filters:
        if label in failed_before:
            notes.append(f"{label}: failed in the earlier results, not compared")
        elif label not in stored_labels:
            notes.append(f"{label}: new, not compared")
    for label, point in failures_before:
        if label in stored_labels and label in new.filters:
            words = ", ".join(filter(None, [label, heading(point)]))
            notes.append(f"{words}: failed in the earlier results, not compared")
    return Verdict(name=new.config["name"], rows=rows, failed=failed, removed=removed, notes=notes)


def _losing_every_run(results: Results) -> list[tuple[str, GridPoint]]:
    """List the filters that lost every run at a point of the grid, with the point."""
    losing = []
    for point in results.points():
        rows = results.columns("summary", point).records()
        for label in results.filters:
            of_filter = [row for row in rows if row["filter"] == label]
            is_lost = any(row["lost"] > 0 for row in of_filter)
            # The share of lost runs is known even then: it is over all runs.
            has_run = any(
                row["runs"] > 0 and measured(row["metric"]).metric != "lost" for row in of_filter
            )
            if is_lost and not has_run:
                losing.append((label, point))
    return losing


def _find_removed(stored: Results, new: Results, stored_labels: Sequence[str]) -> Iterator[Removed]:
    """Yield the filters, points of the grid, errors and scores that the new results lack.

    ``stored_labels`` are the filters with stored numbers.
    """
    for label in stored_labels:
        if label not in new.config["filters"]:
            yield Removed(filter=label)
    for point in stored.points():
        if point not in new.points():
            yield Removed(point=point)
    failed = {row["filter"] for row in new.failed}
    new_metrics = errors_and_scores(new.columns("summary").records(), new.filters)
    stored_metrics = errors_and_scores(stored.columns("summary").records(), stored.filters)
    for label, metrics in stored_metrics.items():
        if label not in new_metrics or label in failed:
            continue  # the whole filter is gone, or is reported as failed
        for metric in metrics:
            if metric not in new_metrics[label]:
                yield Removed(filter=label, metric=metric)


def judge(rows: Sequence[Row], limit: Limit) -> list[Row]:
    """Return the rows with their verdicts, by one-sided tests that Holm's method corrects.

    ``limit.sigmas`` is the false alarm rate of all tests together, as standard deviations of a normal
    tail.
    A row compares a metric of a filter in new and stored results. Its ``change`` compares the two
    numbers, and its ``difference`` is the new number less the stored one. ``worse`` compares how far
    both are from the best value: a positive z says that the new number is worse. The p-value of a row is
    that of the test on the side of this z. A significant difference is negligible unless its size is
    larger than the share ``limit.share`` of the stored value. A share of runs, which has no such limit,
    is always worse or better.
    """
    # Equal numbers need no test: the tests ignore NaN.
    zs = [nan if row.how == EQUAL else row.worse.z for row in rows]
    # A sign is 1 or -1 for a number that is significantly worse or better, else 0.
    p_values, signs = signs_beyond(zs, limit.sigmas)
    judged = []
    for row, z, p, sign in zip(rows, zs, p_values, signs, strict=True):
        if row.how == EQUAL:
            word = EQUAL
        elif sign:
            stored_number = row.change.b  # `change` compares a, the new number, with b
            least_change = limit.share * abs(stored_number.value)
            if is_event(row.metric) or abs(row.difference.value) > least_change:
                word = WORSE if sign == 1 else BETTER
            else:
                word = NEGLIGIBLE
        elif isnan(z):
            word = UNTESTED
        else:
            word = ALIKE
        judged.append(row._replace(change=row.change._replace(p=float(p)), verdict=word))
    return judged


def _compare_costs(stored: Results, new: Results, largest_ratio: float) -> list[Row]:
    """Compare the filters' numbers of evaluations, and their CPU times if both ran on one machine.

    The numbers are those of likelihoods and of covariance updates. A cost is worse if it is more than
    ``largest_ratio`` times the stored cost; it has no test. A ratio of 0 compares none, and so do
    results without measured costs.
    """
    both = (stored, new)
    if not largest_ratio or not all((results.folder / TIMING).is_file() for results in both):
        return []
    machines = {(r.manifest.get("processor"), r.manifest.get("platform")) for r in both}
    kinds = ["likelihoods", "covariances"]  # columns of timing.csv
    if len(machines) == 1:
        kinds.append("cpu_s_per_run")
    stored_costs = _costs_by_point(stored)
    new_costs = _costs_by_point(new)
    rows = []
    for kind in kinds:
        for key in new_costs:
            if key not in stored_costs:
                continue
            stored_cost = _cost(stored_costs[key][kind])
            new_cost = _cost(new_costs[key][kind])
            if not stored_cost > 0.0 or isnan(new_cost):
                continue  # not measured, or a ratio to 0
            is_equal = stored_cost == new_cost
            word = EQUAL if is_equal else ALIKE
            if new_cost > largest_ratio * stored_cost:
                word = WORSE
            # Without standard errors the comparison has a difference and no test.
            change = compare_independent(
                RunEstimate(value=new_cost, stderr=nan, influences=None, runs=1),
                RunEstimate(value=stored_cost, stderr=nan, influences=None, runs=1),
            )
            *values, label = key
            rows.append(
                Row(
                    point=dict(zip(new.grid, values, strict=True)),
                    filter=label,
                    metric=kind,
                    how=EQUAL if is_equal else COST,
                    change=change,
                    worse=change,  # more is worse, so that the sign stays
                    verdict=word,
                )
            )
    return rows


def _costs_by_point(results: Results) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Return the rows of timing.csv by key: the values of the grid's paths, then the filter's label.

    A row has the cells by column.
    """
    rows = {}
    for row in results.columns("timing").records():
        values = [row.get(path) for path in results.grid]
        rows[(*values, row["filter"])] = row
    return rows


def _cost(cell: Any) -> float:
    """Return the number in a cell of timing.csv; NaN for one that is not measured."""
    return nan if cell == "-" else float(cell)
