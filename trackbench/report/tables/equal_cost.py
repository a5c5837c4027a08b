"""Table kind `equal-cost`: errors of the filters at one CPU time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.elementary import exp
from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.cost_curves import COST, MICRO, compared_labels, cost_conflicts, curves
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.points_by_scenario import scenes
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.error_at_cpu_time import AtCost, Curve, Spot, compare_at, logarithm
from trackbench.statistics.holm_correction import as_family
from trackbench.statistics.sample_statistics import Estimate


@register("tables", "equal-cost")
@dataclass(frozen=True, kw_only=True)
class EqualCost(TableKind):
    """Each filter at the CPU time of one of them, at each number of particles that this one has.

    Between two of its own numbers of particles a filter's logarithmic error is taken as linear in its
    logarithmic time. The standard error is that of the runs and of the times; beside it stands how much
    the next term of the interpolation would change. The notes name the best filter and those without a
    significant difference from it, by the rule for filters and the interpolation's own error.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("of",)
    requires: ClassVar[dict[str, str]] = {"cpu_s_per_run": "summary"}

    of: str
    """label of the filter at whose times the others are looked at"""
    metric: Expression = measure("mean(rmse)")
    """what is compared: an RMSE, a distance or an efficiency"""
    along: str = "N"
    """the filters' key that buys accuracy with time"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all but the reference"""
    digits: Digits = 4
    """significant digits of the values"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Require a grid, and times of the named filter."""
        return cost_conflicts(points, self.metric, self.along, {"of": self.of})

    def table(self, results: Results) -> Table:
        """Compare the filters at the CPU times of each size of the filter `of`.

        The size is the value of the key `along`, such as the number of particles. Each scenario of the
        grid has rows of its own.
        """
        every_scene = scenes(results)
        key_heads = [*map(results.axis, every_scene[0]), f"At {self.of}'s {self.along}", "Filter"]
        value_heads = [COST, self.along, str(self.metric), "Interpolation", f"Over {self.of}'s"]
        table = Table(self.title, key_heads, value_heads, self.digits)
        labels = compared_labels(results, self.filters)
        for scene in every_scene:
            # Curves of error over CPU time; each size of the filter `of` gives a budget.
            labels_of_curves = list(dict.fromkeys([*labels, self.of]))
            all_curves = curves(results, scene, labels_of_curves, self.metric, self.along)
            rivals = [curve for curve in all_curves if curve.label in labels]
            for curve in all_curves:
                if curve.label != self.of:
                    continue
                for spot in curve.spots:
                    # A curve of one of several forms has the form behind the label: "PF (R = 2)".
                    size = phrases.number(spot.size) + curve.name.removeprefix(self.of)
                    keys = [*map(phrases.number, scene.values()), size]
                    self._add_budget(table, keys, rivals, spot)
        return table

    def _add_budget(
        self, table: Table, keys: list[str], rivals: Sequence[Curve], budget: Spot
    ) -> None:
        """Add a row for each rival at the CPU time of the spot ``budget``, and the conclusion as a note.

        ``budget`` is the filter of the table's key `of` at one of its sizes. ``keys`` are the first
        columns of the rows: values of the scenario, and this size. ``rivals`` are the curves of the
        compared filters.
        """
        reference = AtCost(size=budget.size, error=logarithm(budget.error), lost=budget.lost)
        # Every filter's error at this CPU time; None where its own times do not reach.
        errors = {curve.name: curve.error_at(budget.cost) for curve in rivals}
        reached = {name: error for name, error in errors.items() if error is not None}
        comparison = _compare(reached, self.metric.definition.more_is_better)
        marked = _marked_at_equal_cost(reached, comparison.best, comparison.ties)
        for name, error in errors.items():
            # The number of rows so far is the index of this one.
            if name in marked:
                table.best.add((len(table.keys), table.value_headers.index(str(self.metric))))
            cells = [Cell.missing()] * 4 if error is None else _cells(error, reference)
            # CPU time per step, in microseconds as the heading has it. No run is lost for a time: runs
            # of which the filter loses the target take time, too. Its runs are those of the results, and
            # not those of a timed block.
            time = Estimate(MICRO * budget.cost.value, MICRO * budget.cost.stderr)
            table.add([*keys, name], [Cell(time, runs=len(budget.lost), lost=0), *cells])
        if reached:
            heads_of_keys = table.key_headers[:-1]  # without that of the filter
            table.notes.append(_conclusion(heads_of_keys, keys, budget, comparison))


class _Comparison(NamedTuple):
    """Filters at one CPU time, by name."""

    best: list[str]
    """the filter with the best error; empty if no filter's times reach this one"""
    ties: list[str]
    """filters without a significant difference from the best, up to the first with one"""
    losing_fewer: list[str]
    """filters that are worse than the best, or behind a worse one, and lose fewer runs than the best"""


def _compare(errors: dict[str, AtCost], higher: bool) -> _Comparison:
    """Find the best filter, its ties, and worse filters that lose fewer runs than the best.

    ``errors`` are by the filter's name. The lowest is the best, or the highest if ``higher`` is set, as
    for efficiencies. Ties have no significant difference from the best. The lists are empty without
    errors.
    """
    # Times this sign, a lower error is a better one.
    sign = -1.0 if higher else 1.0
    order = sorted(errors, key=lambda name: sign * errors[name].error.value)
    # Each filter with every one before it in the order; below only significance counts, not the sign.
    pairs = {(a, b): compare_at(errors[b], errors[a]) for a, b in combinations(order, 2)}
    family = as_family(pairs)
    best = order[:1]
    ties: list[str] = []
    losing_fewer: list[str] = []
    for place, name in enumerate(order[1:]):
        # A filter behind a significantly worse one is no tie. A worse filter may still lose fewer runs.
        is_significant = family[best[0], name].sign != 0
        all_before_are_ties = len(ties) == place
        if not is_significant and all_before_are_ties:
            ties.append(name)
        elif rules.loses_more(errors[best[0]].lost, errors[name].lost, filters=len(errors)):
            losing_fewer.append(name)
    return _Comparison(best=best, ties=ties, losing_fewer=losing_fewer)


def _marked_at_equal_cost(
    errors: Mapping[str, AtCost], best: Sequence[str], ties: Sequence[str]
) -> list[str]:
    """Return the filters that are marked at one CPU time: the best, and ties up to one not near it.

    ``errors`` are by the filter's name. ``best`` is a list of one filter, or empty without ``errors``;
    ``ties`` are the filters without a significant difference from it. The list is empty if a tie is not
    near and no filter is worse, as nothing is then decided.
    """
    near: list[str] = []
    for name in ties:
        if not _is_near(errors[name], errors[best[0]]):
            break
        near.append(name)
    all_near = len(near) == len(ties)
    some_worse = len([*best, *ties]) < len(errors)
    if all_near or some_worse:
        return [*best, *near]
    return []


def _is_near(error: AtCost, best: AtCost) -> bool:
    """Test whether the ratio to the best error is at most `rules.NEAR_BEST`, with 95 % confidence."""
    # The interval of the logarithm of the ratio. Times and interpolation add to the error of the runs.
    other_stderr = float(np.hypot(error.other_stderr, best.other_stderr))
    low, high = compare_at(error, best).difference.interval(other=other_stderr)
    # The logarithm is negative for an efficiency, of which the best is the highest.
    return max(abs(low), abs(high)) <= np.log(rules.NEAR_BEST)


def _conclusion(heads: list[str], keys: list[str], budget: Spot, comparison: _Comparison) -> str:
    """Write which filters are best at one CPU time.

    ``heads`` and ``keys`` are headings and texts of the scenario's values, and last of the size of the
    filter whose CPU time is the ``budget``.
    """
    place = [f"{heads[-1]} = {keys[-1]}"]
    for head, key in zip(heads[:-1], keys[:-1], strict=True):
        place.append(f"{head} = {key}")
    parts = [f"best {comparison.best[0]}"]
    if comparison.ties:
        parts.append(f"no significant difference: {', '.join(comparison.ties)}")
    if comparison.losing_fewer:
        parts.append(f"losing fewer runs: {', '.join(comparison.losing_fewer)}")
    time = f"{MICRO * budget.cost.value:.3g} µs a step"
    return f"{', '.join(place)} ({time}): {'; '.join(parts)}."


def _cells(at_budget: AtCost, reference: AtCost) -> list[Cell]:
    """Return the cells of size, error, interpolation error, and ratio to the error of ``reference``.

    The errors of ``at_budget`` and ``reference`` are logarithms, whose standard errors are relative.
    ``curvature`` is what the linear interpolation of the logarithm may leave out. ``other_stderr`` is
    the standard error that does not come from the runs: of the CPU times and of the interpolation. Both
    filters share their runs, so only the errors of the runs are paired.
    """
    value = float(exp(at_budget.error.value))
    # Relative errors from the runs and from the times add in squares.
    stderr = value * float(np.hypot(at_budget.error.stderr, at_budget.stderr_of_times))
    difference = compare_at(at_budget, reference).difference
    ratio = float(exp(difference.value))
    other_stderr = float(np.hypot(at_budget.other_stderr, reference.other_stderr))
    ratio_stderr = ratio * float(np.hypot(difference.stderr, other_stderr))
    estimates = [
        Estimate(at_budget.size, np.nan),
        Estimate(value, stderr),
        Estimate(value * at_budget.curvature, np.nan),
        Estimate(ratio, ratio_stderr),
    ]
    lost = int((at_budget.lost > 0).sum())
    return [Cell(estimate, at_budget.error.runs, lost) for estimate in estimates]
