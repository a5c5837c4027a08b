"""Differences of every two filters on common runs, with the word of the verdicts' rule; paired.csv."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import isnan
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import measured
from trackbench.statistics.estimates import OfSteps, RunEstimate
from trackbench.statistics.over_runs import STATISTICS, influence, mean, without_rounding
from trackbench.statistics.rules import difference_sign
from trackbench.statistics.series import series_mean


class Pair(NamedTuple):
    """Mean over runs of the difference ``a - b`` of a metric, its test, and the verdict on filter a."""

    filter_a: str
    filter_b: str
    metric: str
    difference: float
    stderr: float
    z: float
    runs: int
    interval: tuple[float, float]
    """95 % confidence interval of the mean difference"""
    verdict: str
    """better, worse, no significant difference, or untested if there is no standard error"""


COLUMNS = Pair._fields[:7]
"""Columns of paired.csv after those of the grid."""


def primary_metrics(metrics: list[str]) -> list[str]:
    """Return metrics over the whole run: ``rmse_<quantity>``, ``crps_...``, log scores.

    Of a log score more is better: a positive difference is in favor of the first filter.
    """
    found = ((name, measured(name)) for name in metrics)
    rows = ((name, m.family[0]) for name, m in found if m.is_row and not m.window)
    return [name for name, metric in rows if metric.name in ("rmse", "crps") or metric.is_score]


def pairs_at(
    runs: Mapping[tuple[str, str], Array],
    labels: Sequence[str],
    steps: Mapping[tuple[str, str], Array],
    batches: int,
) -> list[Pair]:
    """Return pairs at one point of the grid, metric after metric, from values by (filter, metric).

    ``steps`` are those of the only run, if it is a recording. The rule of the verdicts leaves out each
    of so many ``batches`` of runs.
    """
    found: list[Pair] = []
    for metric in primary_metrics(list(dict.fromkeys(m for _, m in runs))):
        there = [label for label in labels if (label, metric) in runs]
        values, series = (
            {label: of[label, metric] for label in there if (label, metric) in of}
            for of in (runs, steps)
        )
        found += pairs_of(metric, there, values, series, batches)
    return found


def difference_of(statistic: str, a: Array, b: Array) -> RunEstimate:
    """Return the difference of a statistic over common runs (M,), with the runs' influences on it."""
    if statistic == "mean":
        differences = without_rounding(a, b)
        return RunEstimate(*mean(differences), influence("mean", differences), len(a))
    b = np.where(without_rounding(a, b) == 0.0, a, b)
    of = influence(statistic, a) - influence(statistic, b)
    over = STATISTICS[statistic]
    return RunEstimate(over(a).value - over(b).value, mean(of).stderr, of, len(a))


@np.errstate(all="ignore")
def pairs_of(
    metric: str,
    labels: list[str],
    values: dict[str, Array],
    steps: Mapping[str, Array] = MappingProxyType({}),
    batches: int = 1,
) -> list[Pair]:
    """Return every two of the labels whose values per run (M,) have runs in common.

    One run alone is judged by its ``steps`` (T,), whose mean is the value.
    """
    found, better = [], 1 if measured(metric).family[0].more_is_better else -1
    for a, b in combinations(labels, 2):
        both = np.isfinite(values[a]) & np.isfinite(values[b])
        if not both.any():
            continue
        term = difference_of("mean", values[a][both], values[b][both])
        z = term.z()
        if term.runs == 1 and a in steps and b in steps:
            of_steps = steps[a] - steps[b]
            term, z = OfSteps.of(term.value, of_steps), series_mean(of_steps).z
        sign = better * difference_sign(term, batches)
        word = "untested" if isnan(z) else ("no significant difference", "better", "worse")[sign]
        of_runs = term.value, term.stderr, z, term.runs, term.interval(), word
        found.append(Pair(a, b, metric, *of_runs))
    return found
