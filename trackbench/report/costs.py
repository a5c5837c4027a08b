"""Error of a filter over its cost: points over particle counts, interpolated between them.

Between two of a filter's sizes the logarithm of its error is linear in the logarithm of its CPU time, as
it is wherever the error falls with a power of the number of particles. Three things make that uncertain:
the errors at both ends, which all filters share with their runs; the times at both ends and the one that
is asked for; and that the error is not linear there. The last is the next term of Newton's interpolation
formula, with the nearest further size on either side, the larger of both (Abramowitz and Stegun 1964,
25.2.4 and 25.1.4).
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.core.elementary import exp, log
from trackbench.evaluation.metric_expression import Measure, measure
from trackbench.field_types import is_number
from trackbench.report.expressions import Evaluator
from trackbench.report.results import Results, named_form, points_of
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.comparison import Comparison, compare_estimates
from trackbench.statistics.estimates import RunEstimate, ignore_float_errors, linear_combination

_TIME = measure("cpu_s_per_run")
COST, MICRO = "CPU time per step (µs)", 1e6


class Spot(NamedTuple):
    """A filter at one of its sizes."""

    size: float
    cost: RunEstimate
    """CPU time per step, s"""
    error: RunEstimate
    lost: Array
    """why each run (M,) is lost, 0 where it is not"""


class AtCost(NamedTuple):
    """A filter at a cost, between two of its sizes or at one."""

    size: float
    error: RunEstimate
    """logarithm of the error, with each run's influence and the error of the runs alone"""
    of_times: float = 0.0
    """standard error of the same by the times at both ends and the one that is asked for"""
    curvature: float = 0.0
    """size of what the interpolation leaves out; NaN if there are no three sizes"""
    lost: Array = np.empty(0)

    @property
    def other(self) -> float:
        """Part of the uncertainty that the runs do not show."""
        return float(np.hypot(self.of_times, self.curvature))


@dataclass(frozen=True)
class Curve:
    """A filter over its sizes, the smallest first; a single one if it has none."""

    label: str
    spots: tuple[Spot, ...]
    name: str = ""
    """the label, with what else varies of the filter"""

    @property
    def is_fixed(self) -> bool:
        """True if the filter has a single size, hence a single cost."""
        return len(self.spots) == 1

    def at(self, cost: RunEstimate) -> AtCost | None:
        """Return the error at a CPU time per step, s; None outside the filter's own times.

        Where several sizes take that time, at the largest. What is fixed is had at all above its own.
        """
        match = next((spot for spot in self.spots if spot.cost is cost), None)
        if match is not None:
            return AtCost(match.size, logged(match.error), lost=match.lost)
        if self.is_fixed:
            (spot,) = self.spots
            dear = spot.cost.value > cost.value
            return None if dear else AtCost(spot.size, logged(spot.error), lost=spot.lost)
        x = [float(log(spot.cost.value)) for spot in self.spots]
        wanted = float(log(cost.value))
        for i in reversed(range(len(x) - 1)):
            if min(x[i : i + 2]) <= wanted <= max(x[i : i + 2]) and x[i] != x[i + 1]:
                return self._between(i, x, wanted, logged(cost).stderr)
        return None

    @ignore_float_errors
    def _between(self, i: int, x: Sequence[float], wanted: float, of_cost: float) -> AtCost:
        (a, b), share = self.spots[i : i + 2], (wanted - x[i]) / (x[i + 1] - x[i])
        y = [logged(spot.error) for spot in self.spots]
        slope = (y[i + 1].value - y[i].value) / (x[i + 1] - x[i])
        ends = (1.0 - share) * logged(a.cost).stderr, share * logged(b.cost).stderr
        value = (1.0 - share) * y[i].value + share * y[i + 1].value
        bent = [
            abs(_second_difference(x, y, n) * (wanted - x[i]) * (wanted - x[i + 1]))
            for n in (i - 1, i)
            if 0 <= n < len(x) - 2
        ]
        sizes = [float(log(spot.size)) for spot in (a, b)]
        return AtCost(
            float(exp((1.0 - share) * sizes[0] + share * sizes[1])),
            linear_combination(value, y[i], y[i + 1], 1.0 - share, share),
            abs(slope) * float(np.sqrt(of_cost**2 + ends[0] ** 2 + ends[1] ** 2)),
            max(bent, default=np.nan),
            np.maximum(a.lost, b.lost),
        )


def own_sizes(points: Sequence[Point], label: str, key: str) -> list[Any]:
    """Return the numbers that a key of a filter takes over the grid; none if it has no such key."""
    values = [getattr(point.filters.get(label), key, None) for point in points]
    return [value for value in dict.fromkeys(values) if is_number(value)]


def cost_conflicts(
    points: Sequence[Point], metric: Measure, key: str, varied: Mapping[str, str]
) -> dict[str, str]:
    """Return conflicts of a table or figure over costs, by key; ``varied`` filters must vary."""
    if not points[0].values:
        return {"": f"there is no grid: give {key} of the filters several values"}
    is_made = metric.is_efficiency or metric.family[0].over_steps == "rms"
    conflicts = {} if is_made else {"metric": f"'{metric}' is no RMSE, distance or efficiency"}
    for where, label in varied.items():
        number = len(own_sizes(points, label, key))
        if label in points[0].filters and number < 2:
            values = "one value" if number else "no value"
            conflicts[where] = f"{key} of {label} takes {values} over the grid; two are needed"
    return conflicts


def shown(results: Results, wanted: Collection[str] | None) -> list[str]:
    """Return the filters that are compared: those named, or all but the reference."""
    reference = None if wanted is not None else results.config.get("reference")
    return [b for b in results.chosen(wanted) if b in results.filters and b != reference]


def curves(
    results: Results, scene: GridPoint, labels: Sequence[str], metric: Measure, key: str
) -> list[Curve]:
    """Return every filter's errors and times in a scene, a curve for each set of its other keys."""
    groups: dict[tuple[str, str], tuple[dict[str, Any], dict[float, Spot]]] = {}
    for point in points_of(results, scene):
        filters, expressions = results.facts(point).filters, Evaluator(results, point)
        for label in (label for label in labels if label in filters):
            keys = {name: value for name, value in filters[label].items() if name != key}
            size = float(filters[label].get(key, np.nan))
            _, spots = groups.setdefault((label, json.dumps(keys)), (keys, {}))
            if size not in spots:
                time, steps = expressions.term(_TIME.of(label)), results.steps(point)
                cost = time.scaled(time.value / steps, over=steps)
                lost = expressions.runs.get((label, "lost"), np.empty(0))
                spots[size] = Spot(size, cost, expressions.term(metric.of(label)), lost)
    every: list[Curve] = []
    for (label, _), (keys, spots) in groups.items():
        # Sizes at which the filter did not fail.
        in_order = [spots[size] for size in sorted(spots)]
        good = [s for s in in_order if 0.0 < s.cost.value < np.inf and 0.0 < s.error.value < np.inf]
        forms = [of_other for (other, _), (of_other, _) in groups.items() if other == label]
        if good:
            every.append(Curve(label, tuple(good), named_form(label, keys, forms)))
    return every


@ignore_float_errors
def logged(term: RunEstimate) -> RunEstimate:
    """Return the logarithm of a positive number, with its error (delta method)."""
    return term.scaled(float(log(term.value)), over=term.value)


def _second_difference(x: Sequence[float], y: Sequence[RunEstimate], i: int) -> float:
    """Return ``f[x_i, x_i+1, x_i+2]``."""
    first, second = (np.divide(y[j + 1].value - y[j].value, x[j + 1] - x[j]) for j in (i, i + 1))
    return float((second - first) / (x[i + 2] - x[i]))


def compare_at(a: AtCost, b: AtCost) -> Comparison:
    """Return the comparison of the logarithms of two errors, with their further uncertainty."""
    return compare_estimates(a.error, b.error, float(np.hypot(a.other, b.other)))


def front(spots: Sequence[Spot], higher: bool = False) -> Iterator[Spot]:
    """Return the points that no other beats at the same cost or less, cheapest first."""
    best, sign = np.inf, -1.0 if higher else 1.0
    for spot in sorted(spots, key=lambda s: (s.cost.value, sign * s.error.value)):
        if sign * spot.error.value < best:
            best = sign * spot.error.value
            yield spot
