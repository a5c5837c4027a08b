"""Columns of per_step.csv: metrics of one filter at every step."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Index
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.series_sums import StepSums
from trackbench.metrics import metric_of, metrics_of
from trackbench.statistics.sample_statistics import (
    Estimates,
    deviation_from_sums,
    mean_from_sums,
    median,
    rooted,
)


class StepColumns(NamedTuple):
    """Metrics of one series, at the steps at which any run has a value."""

    positions: Index
    """places (S,) of these steps among all"""
    metrics: dict[str, Estimates]
    """values and standard errors (S,) over the runs that are not lost"""
    runs: Index
    """number of these runs (S,)"""


def step_columns(result: FilterResult, sizes: Mapping[str, int]) -> Iterator[StepColumns]:
    """Yield the metrics of each series at every step, as per_step.csv has them.

    They are ``rmse``, ``bias``, ``std``, other means over the runs, and medians of stored series.

    Parameters
    ----------
    result
        result of one filter over all runs
    sizes
        number of components of each NEES by its marginal, a part of the state such as "position", or ""
        for the whole state

    Yields
    ------
    StepColumns
        metrics of one series
    """
    for name, sums in result.steps.items():
        # The series `unused_nees` counts the components that a NEES lacks. If it lacks none in any run,
        # the series is left out.
        if name.startswith("unused_") and not sums.total.any():
            continue
        # From the sums: metrics at the steps where any run has a value.
        known = np.flatnonzero(sums.number)
        metrics = {
            metric: Estimates(value=estimates.value[known], stderr=estimates.stderr[known])
            for metric, estimates in _step_metrics(name, sums, sizes)
        }
        yield StepColumns(positions=known, metrics=metrics, runs=sums.number[known].astype(int))
    # From the stored series of all runs: medians.
    for name, rows in result.run_series.items():
        number = (~np.isnan(rows)).sum(axis=1)
        known = np.flatnonzero(number)
        medians = [median(row[~np.isnan(row)]) for row in rows[known]]
        values = np.array([estimate.value for estimate in medians])
        stderrs = np.array([estimate.stderr for estimate in medians])
        over_steps = Estimates(value=values, stderr=stderrs)
        yield StepColumns(
            positions=known, metrics={f"median({name})": over_steps}, runs=number[known]
        )


def _step_metrics(
    series: str, sums: StepSums, sizes: Mapping[str, int]
) -> Iterator[tuple[str, Estimates]]:
    """Yield the name and the values of each metric of a series at every step (T + 1,).

    ``sums`` are the sums of the series over the runs; a step without a value in any run has NaN.
    ``sizes`` has the number of components of each NEES by its marginal, a part of the state such as
    "position", or "" for the whole state.
    """
    # The metric's definition decides: root of a mean square, standard deviation, or mean, which may be
    # divided by the number of components. A metric without such a definition has no value at a step.
    mean_over_runs = mean_from_sums(sums.total, sums.squares, sums.number)
    for metric, name in metrics_of(series):
        if metric.over_runs == "rms":
            yield name, rooted(mean_over_runs)
        elif metric.over_runs == "std":
            yield name, deviation_from_sums(sums.total, sums.squares, sums.number)
        elif metric.over_runs:
            n = 1
            if metric.per_component:
                _, quantity = metric_of(series)
                n = sizes[quantity]
            stderr = mean_over_runs.stderr / n
            yield name, Estimates(value=mean_over_runs.value / n, stderr=stderr)
