"""Table kinds of what accuracy costs: `efficiency`, and `equal-cost`, errors at one CPU time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, takewhile
from typing import Any, ClassVar

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.elementary import exp
from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.costs import (
    COST,
    MICRO,
    AtCost,
    Curve,
    Spot,
    compare_at,
    cost_conflicts,
    curves,
    logged,
    shown,
)
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results, named_form, points_of, scenes
from trackbench.report.table import Cell, Table
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.comparison import as_family
from trackbench.statistics.efficiency import cross_share, efficiency, plain_efficiency, runs_saved
from trackbench.statistics.over_runs import Estimate

_NOT_EXACT = "the cross term is not zero, the reference is no exact mean: take the one without"


@register("tables", "efficiency")
@dataclass(frozen=True, kw_only=True)
class EfficiencyTable(TableKind):
    """The reference's RMSE over each filter's, with the cross term as a control variate and without.

    `Runs saved`: runs that would be needed without it for each with it. `Cross term`: its share of the
    mean square error, which is zero but for noise if the reference is the exact posterior mean.
    """

    metric: Expression = measure("efficiency")
    """which: `efficiency_position`, `efficiency[late]`"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all but the reference"""
    digits: Digits = 4
    """significant digits of the values"""

    def conflicts(self, points: Sequence[Any]) -> dict[str, str]:
        """Reject a metric that is no efficiency."""
        return {} if self.metric.is_efficiency else {"metric": f"'{self.metric}' is no efficiency"}

    def table(self, results: Results) -> Table:
        """Fill a row for each scenario and each form of a filter."""
        heads = ["Efficiency", "Without control variate", "Runs saved", "Cross term / MSE"]
        every, labels = scenes(results), shown(results, self.filters)
        table = Table(self.title, [*map(results.axis, every[0]), "Filter"], heads, self.digits)
        for scene in every:
            for label in labels:
                for name, point in _forms(results, scene, label):
                    cells = self._cells(Evaluator(results, point), label)
                    keys = [*map(phrases.number, scene.values()), name]
                    table.add(keys, cells)
                    # A cross term beyond chance shows that the reference is not the exact mean.
                    if rules.is_no_chance(cells[-1].estimate, cells[-1].runs):
                        table.notes.append(f"{' '.join(keys)}: {_NOT_EXACT}.")
        return table

    def _cells(self, expressions: Evaluator, label: str) -> list[Cell]:
        m = self.metric.of(label)
        floor, distance = expressions.reference_and_rmsd(m)
        error = expressions.runs.get((label, str(m.made_of()[0])))
        if floor is None or distance is None or error is None:
            return [Cell.missing()] * 4
        # Only runs in which all three numbers exist.
        runs = np.stack([floor, distance, error])
        floor, distance, error = runs[:, ~np.isnan(runs).any(axis=0)]
        if not len(floor):
            return [Cell.missing()] * 4
        lost = runs.shape[1] - len(floor)
        with_, without = efficiency(floor, distance), plain_efficiency(floor, error)
        cross = cross_share(floor, error, distance)
        estimates = (with_, without, runs_saved(without, with_), cross)
        return [Cell(part.estimate, len(floor), lost) for part in estimates]


def _forms(results: Results, scene: GridPoint, label: str) -> Iterator[tuple[str, GridPoint]]:
    """Yield the filter with each of its varied key sets, their name, and the first point."""
    variants: list[dict[str, Any]] = []
    points = []
    for point in points_of(results, scene):
        keys = results.facts(point).filters.get(label)
        if keys is not None and keys not in variants:
            variants.append(keys)
            points.append(point)
    yield from zip((named_form(label, keys, variants) for keys in variants), points, strict=True)


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
        """Compare the filters at the CPU times of each size of the filter `of`."""
        every, metric = scenes(results), str(self.metric)
        heads = [*map(results.axis, every[0]), f"At {self.of}'s {self.along}", "Filter"]
        values = [COST, self.along, metric, "Interpolation", f"Over {self.of}'s"]
        table = Table(self.title, heads, values, self.digits)
        labels = shown(results, self.filters)
        for scene in every:
            wanted = dict.fromkeys([*labels, self.of])
            # Curves of error over CPU time; each size of the filter `of` gives a budget.
            in_scene = curves(results, scene, list(wanted), self.metric, self.along)
            rivals = [curve for curve in in_scene if curve.label in labels]
            for curve in in_scene:
                for spot in curve.spots if curve.label == self.of else ():
                    size = phrases.number(spot.size) + curve.name.removeprefix(self.of)
                    keys = [*map(phrases.number, scene.values()), size]
                    self._add(table, keys, rivals, spot)
        return table

    def _add(self, table: Table, keys: list[str], rivals: Sequence[Curve], budget: Spot) -> None:
        """Add the rows at one CPU time, and the conclusion."""
        reference = AtCost(budget.size, logged(budget.error), lost=budget.lost)
        # Every filter's error at this CPU time; None where its own times do not reach.
        errors = {curve.name: curve.at(budget.cost) for curve in rivals}
        reached = {name: at for name, at in errors.items() if at is not None}
        best, open_, fewer = _compared(reached, self.metric.family[0].more_is_better)
        near = [*takewhile(lambda name: _is_near(reached[name], reached[best[0]]), open_)]
        decides = len(near) == len(open_) or len(open_) + 1 < len(reached)
        for name, at in errors.items():
            if decides and name in (*best, *near):
                table.best.add((len(table.keys), table.value_headers.index(str(self.metric))))
            cells = [Cell.missing()] * 4 if at is None else _cells(at, reference)
            time = Cell(Estimate(*(MICRO * x for x in budget.cost.estimate)), budget.cost.runs, 0)
            table.add([*keys, name], [time, *cells])
        if reached:
            text = f"{MICRO * budget.cost.value:.3g} µs a step"
            where = ", ".join([*map(" = ".join, zip(table.key_headers[:-2], keys, strict=False))])
            heading = f"{table.key_headers[-2]} = {keys[-1]}" + (f", {where}" if where else "")
            parts = [f"best {best[0]}"]
            parts += [f"no significant difference: {', '.join(open_)}"] if open_ else []
            parts += [f"losing fewer runs: {', '.join(fewer)}"] if fewer else []
            table.notes.append(f"{heading} ({text}): {'; '.join(parts)}.")


def _is_near(at: AtCost, best: AtCost) -> bool:
    ends = compare_at(at, best).difference.interval(other=float(np.hypot(at.other, best.other)))
    return max(map(abs, ends)) <= np.log(rules.NEAR_BEST)


def _cells(at: AtCost, reference: AtCost) -> list[Cell]:
    """Fill size, error, interpolation error, and the ratio to the named filter's error."""
    value, difference = float(exp(at.error.value)), compare_at(at, reference).difference
    other = float(np.hypot(at.other, reference.other))
    ratio = float(exp(difference.value))
    lost = int((at.lost > 0).sum())
    # Of logarithms: relative errors from the runs and from the times add in squares.
    stderr = value * float(np.hypot(at.error.stderr, at.of_times))
    numbers = [
        Estimate(at.size, np.nan),
        Estimate(value, stderr),
        Estimate(value * at.curvature, np.nan),
        Estimate(ratio, ratio * float(np.hypot(difference.stderr, other))),
    ]
    return [Cell(number, at.error.runs, lost) for number in numbers]


def _compared(errors: dict[str, AtCost], higher: bool) -> tuple[list[str], list[str], list[str]]:
    """Find the best filter, those that may be as good, and worse ones that lose fewer runs."""
    sign = -1.0 if higher else 1.0
    order = sorted(errors, key=lambda name: sign * errors[name].error.value)
    pairs = {(a, b): compare_at(errors[b], errors[a]) for a, b in combinations(order, 2)}
    family = as_family(pairs)
    best, open_, fewer = order[:1], list[str](), list[str]()
    for name in order[1:]:
        # Those behind a worse one are no ties. A worse filter may still lose fewer runs.
        if not family[best[0], name].sign and len(open_) == order.index(name) - 1:
            open_.append(name)
        elif rules.loses_more(errors[best[0]].lost, errors[name].lost, len(errors)):
            fewer.append(name)
    return best, open_, fewer
