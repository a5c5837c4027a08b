"""Curves of errors over CPU times: the table `equal-cost` and figure `accuracy-vs-cost` share them."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.evaluation.metric_expression import Measure, measure
from trackbench.field_types import is_number
from trackbench.report.expressions import Evaluator
from trackbench.report.filter_setting_labels import named_form
from trackbench.report.points_by_scenario import points_of
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.error_at_cpu_time import Curve, Spot

_TIME = measure("cpu_s_per_run")
COST = "CPU time per step (µs)"
MICRO = 1e6
"""Microseconds of a second."""


def compared_labels(results: Results, labels: Collection[str] | None) -> list[str]:
    """Return the filters that are compared: those of ``labels``, or if it is None all but the reference.

    Bounds and exact errors are left out.
    """
    reference = None
    if labels is None:
        reference = results.config.get("reference")
    chosen = results.chosen(labels)
    return [label for label in chosen if label in results.filters and label != reference]


class _Form(NamedTuple):
    """A filter with one set of all its keys but the size, and its errors and times by size."""

    label: str
    other_keys: dict[str, Any]
    spots: dict[float, Spot]


def curves(
    results: Results, scene: GridPoint, labels: Sequence[str], metric: Measure, key: str
) -> list[Curve]:
    """Return curves of the filters' errors over their CPU times per step in one scenario of the grid.

    ``scene`` has the values of this scenario, by path, and ``metric`` is the error. ``key`` is the
    filters' key for the size, such as the number of particles. A filter has a curve for each set of
    values that the grid gives its other keys. The curve of a filter without the key is one spot, whose
    size is NaN.
    """
    # Step 1: error and time of each form of a filter at each of its sizes.
    forms: dict[tuple[str, str], _Form] = {}
    for point in points_of(results, scene):
        filters = results.facts(point).filters
        evaluator = Evaluator(results, point)
        for label in labels:
            if label not in filters:
                continue
            other_keys = {name: value for name, value in filters[label].items() if name != key}
            size = float(filters[label].get(key, np.nan))
            new_form = _Form(label=label, other_keys=other_keys, spots={})
            # Keys as JSON can be hashed, although their values may be dicts and lists.
            form = forms.setdefault((label, json.dumps(other_keys)), new_form)
            # If several points of the grid give the filter the same keys, the first one counts.
            if size not in form.spots:
                time_of_run = evaluator.term(_TIME.of(label))  # s
                steps = results.steps(point)
                # Value, standard error and influences are divided by the number of steps.
                time_of_step = time_of_run.scaled(time_of_run.value / steps, divisor=steps)
                form.spots[size] = Spot(
                    size=size,
                    cost=time_of_step,
                    error=evaluator.term(metric.of(label)),
                    lost=evaluator.runs.get((label, "lost"), np.empty(0)),
                )
    # Step 2: a curve of each form, over the sizes at which the filter did not fail.
    drawn: list[Curve] = []
    for form in forms.values():
        in_order = [form.spots[size] for size in sorted(form.spots)]
        finite = [spot for spot in in_order if 0.0 < spot.cost.value < np.inf]
        usable = [spot for spot in finite if 0.0 < spot.error.value < np.inf]
        if usable:
            variants = [other.other_keys for other in forms.values() if other.label == form.label]
            name = named_form(form.label, form.other_keys, variants)
            drawn.append(Curve(label=form.label, spots=tuple(usable), name=name))
    return drawn


def front(spots: Sequence[Spot], higher: bool = False) -> Iterator[Spot]:
    """Yield the spots, the cheapest first, that are better than all others of the same cost or less.

    A spot is a filter at one of its sizes, with its ``cost`` in CPU time and its ``error``. The lower
    ``error`` is better; if ``higher``, as of an efficiency, the larger one is.
    """
    # Times this sign, a lower value is a better one.
    sign = -1.0 if higher else 1.0
    best = np.inf
    for spot in sorted(spots, key=lambda s: (s.cost.value, sign * s.error.value)):
        if sign * spot.error.value < best:
            best = sign * spot.error.value
            yield spot


def own_sizes(points: Sequence[Point], label: str, key: str) -> list[Any]:
    """Return the numbers that a key of a filter takes over the grid; empty if it has no such key."""
    values = [getattr(point.filters.get(label), key, None) for point in points]
    return [value for value in dict.fromkeys(values) if is_number(value)]


def cost_conflicts(
    points: Sequence[Point], metric: Measure, key: str, varied: Mapping[str, str]
) -> dict[str, str]:
    """Return what is wrong with a table or figure over costs, by the key that is wrong.

    ``metric`` is the compared error. ``key`` is the filters' key for the size, such as the number
    of particles. ``varied`` has the labels of filters for which the grid must vary it, by the key of the
    table or figure that names the filter. A mistake under the key "" is one of the table or figure as a
    whole.
    """
    if not points[0].values:
        return {"": f"there is no grid: give {key} of the filters several values"}
    conflicts = {}
    if not (metric.is_efficiency or metric.definition.over_steps == "rms"):
        conflicts["metric"] = f"'{metric}' is no RMSE, distance or efficiency"
    for naming_key, label in varied.items():
        number = len(own_sizes(points, label, key))
        # A label that no filter has gets a message of its own, by `check_named_filters`.
        if label in points[0].filters and number < 2:
            values = "one value" if number else "no value"
            conflicts[naming_key] = f"{key} of {label} takes {values} over the grid; two are needed"
    return conflicts
