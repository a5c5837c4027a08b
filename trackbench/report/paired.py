"""paired.csv: every pair of filters on common runs, with Holm's correction over all pairs."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.inference import holm, studentised, two_sided
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.statistics import (
    STATISTICS,
    Estimate,
    influence,
    mean,
    series_mean,
    without_rounding,
)


class Pair(NamedTuple):
    """Mean difference ``a - b`` of a metric per run, its z, and p before and after correction."""

    filter_a: str
    filter_b: str
    metric: str
    difference: float
    stderr: float
    z: float
    p: float
    p_holm: float
    runs: int


def primary_metrics(metrics: list[str]) -> list[str]:
    """Return metrics over the whole run: ``rmse_<quantity>``, ``crps_...``, log scores.

    Of a log score more is better: a positive difference is in favour of the first filter.
    """
    found = ((name, measured(name)) for name in metrics)
    rows = ((name, m.family[0]) for name, m in found if m.is_row and not m.window)
    return [name for name, metric in rows if metric.name in ("rmse", "crps") or metric.is_score]


def pairs_at(
    runs: Mapping[tuple[str, str], Array],
    labels: Sequence[str],
    steps: Mapping[tuple[str, str], Array],
) -> list[Pair]:
    """Return pairs at one point of the grid, metric after metric, from values by (filter, metric).

    ``steps`` are those of the only run, if it is a recording.
    """
    found: list[Pair] = []
    for metric in primary_metrics(list(dict.fromkeys(m for _, m in runs))):
        there = [label for label in labels if (label, metric) in runs]
        values, series = (
            {label: of[label, metric] for label in there if (label, metric) in of}
            for of in (runs, steps)
        )
        found += pairs_of(metric, there, values, steps=series)
    return found


def difference_of(statistic: str, a: Array, b: Array) -> tuple[Estimate, Array]:
    """Return the difference of a statistic over common runs (M,), and the runs' influences on it."""
    if statistic == "mean":
        differences = without_rounding(a, b)
        return mean(differences), influence("mean", differences)
    b = np.where(without_rounding(a, b) == 0.0, a, b)
    of = influence(statistic, a) - influence(statistic, b)
    over = STATISTICS[statistic]
    return Estimate(over(a).value - over(b).value, mean(of).stderr), of


@np.errstate(all="ignore")
def pairs_of(
    metric: str,
    labels: list[str],
    values: dict[str, Array],
    statistic: str = "mean",
    steps: Mapping[str, Array] = MappingProxyType({}),
) -> list[Pair]:
    """Return every two of the labels whose values per run (M,) have runs in common.

    One run alone is judged by its ``steps`` (T,), whose mean is the value.
    """
    found = []
    for a, b in combinations(labels, 2):
        both = np.isfinite(values[a]) & np.isfinite(values[b])
        runs = int(both.sum())
        if not runs:
            continue
        difference, influences = difference_of(statistic, values[a][both], values[b][both])
        z = studentised(difference.value, influences)
        if runs == 1 and a in steps and b in steps:
            apart = series_mean(steps[a] - steps[b])
            difference, z = difference._replace(stderr=apart.stderr), apart.z
        p = two_sided(z)
        found.append(Pair(a, b, metric, *difference, z, p, p, runs))
    adjusted = holm(np.array([pair.p for pair in found]))
    return [pair._replace(p_holm=float(p)) for pair, p in zip(found, adjusted, strict=True)]
