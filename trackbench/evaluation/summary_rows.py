"""Summarize one filter over all runs: compute the rows of summary.csv and per_step.csv."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.sums import mean as average
from trackbench.evaluation.block_task import Tracks
from trackbench.evaluation.error_series import StepSums
from trackbench.evaluation.lost_runs import NOT_LOST
from trackbench.evaluation.measure_cpu_times import Measured
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure, measured
from trackbench.metrics import in_window, metric_of, metrics_of
from trackbench.statistics.sample_statistics import (
    STATISTICS,
    Estimates,
    deviation_from_sums,
    mean,
    mean_from_sums,
    median,
    rooted,
)


class Timing(NamedTuple):
    """CPU seconds of one block's filter, and the runs it was computed for."""

    cpu_s: float
    runs: int


class FilterResult(NamedTuple):
    """One filter over all runs: values per run (M,), sums per step, kept series (T + 1, M)."""

    per_run: dict[str, Array]
    steps: dict[str, StepSums]
    run_series: dict[str, Array]
    tracks: Tracks | None
    timing: list[Timing]
    measured: Measured | None = None
    """CPU times of repeated steps, measured in turns with the other filters"""


class SummaryRow(NamedTuple):
    """A statistic of a metric over the runs that are not lost."""

    metric: str
    value: float
    stderr: float
    runs: int
    lost: int


class StepColumns(NamedTuple):
    """Metrics of one series, at the steps at which any run has a value."""

    positions: Index
    """places (S,) of these steps among all"""
    metrics: dict[str, Estimates]
    """values and standard errors (S,) over the runs that are not lost"""
    runs: Index
    """number of these runs (S,)"""


def summary_rows(
    result: FilterResult, sizes: Mapping[str, int], windows: Mapping[str, Mask]
) -> Iterator[SummaryRow]:
    """Yield the rows of summary.csv: ``mean(rmse)``, ``variance(rmse)``, ``rms(rmse)``, ..., ``anees``.

    ``sizes`` has the number of components of each NEES by its marginal, a part of the state such as
    "position", or "" for the whole state. ``windows`` are the masks (T + 1,) of the steps by name.

    ``time-mean(rmse)`` is the mean over a window's steps of the RMSE over runs. Its standard error is
    computed from the runs' shares, the contribution of each run to the time mean, if they are stored.
    Otherwise it is an upper bound, the mean of the steps' own standard errors: errors that are
    correlated in time cannot add up to more.
    """
    lost = int((result.per_run["lost"] != NOT_LOST).sum())
    for metric, values in result.per_run.items():
        m = measured(metric)
        if m.metric == "lost":
            continue
        finite = values[~np.isnan(values)]
        runs = len(finite)
        if m.statistic == TIME_MEAN:
            # These values are the runs' shares of a time mean. `_time_means` computes the mean itself
            # from the sums per step. Results that were read from files have no such sums: there the time
            # mean is the mean of the shares.
            if not result.steps:
                value, stderr = mean(finite)
                yield SummaryRow(metric, value, stderr, runs, lost)
            continue
        # Every statistic of the runs' values, lost runs left out.
        for name, statistic in STATISTICS.items():
            value, stderr = statistic(finite)
            yield SummaryRow(f"{name}({metric})", value, stderr, runs, lost)
        # Means per component, such as ANEES = NEES / n.
        for row, n in per_component(m, sizes):
            value, stderr = mean(finite)
            yield SummaryRow(row, value / n, stderr / n, runs, lost)
    yield from _time_means(result, windows, lost)


def per_component(m: Measure, sizes: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    """Yield the rows of the summary that are m divided by a number of components, such as the ANEES.

    Each is the name of the row and this number. ``sizes`` has it for each NEES by its marginal, the part
    of the state that the NEES is of: "position" for `nees_position`, "" for the whole state. ``m`` is a
    metric per run. A metric at a step has no such row.
    """
    if m.steps is not None:
        return
    quantity = m.quantity  # of a NEES the marginal
    # The metric per run `nees` is also a series, of which the metrics `nees` and `anees` are made.
    for metric, name in metrics_of(m.metric):
        if metric.per_component:
            yield in_window(name, m.window), sizes[quantity]


def _time_means(
    result: FilterResult, windows: Mapping[str, Mask], lost: int
) -> Iterator[SummaryRow]:
    """Yield the mean over each window's steps of the RMSE over the runs.

    ``windows`` are masks (T + 1,) by name, and ``lost`` is the number of lost runs, which every row has.
    """
    for series, sums in result.steps.items():
        names = [name for metric, name in metrics_of(series) if metric.name == "rmse"]
        for name in names:
            for window, mask in windows.items():
                valid = mask & (sums.number > 0)  # the steps at which any run has an error
                if not valid.any():
                    continue
                row = f"{TIME_MEAN}({in_window(name, window)})"
                # RMSE over the runs at each step, then its mean over the steps.
                mean_squares = mean_from_sums(
                    sums.total[valid], sums.squares[valid], sums.number[valid]
                )
                rmse = rooted(mean_squares)
                value, stderr = average(np.stack([rmse.value, rmse.stderr])).tolist()
                # The runs' shares give the standard error; without shares it is an upper bound.
                shares = result.per_run.get(row)
                if shares is not None:
                    stderr = mean(shares[~np.isnan(shares)]).stderr
                yield SummaryRow(row, value, stderr, int(sums.number[mask].max()), lost)


def step_columns(result: FilterResult, sizes: Mapping[str, int]) -> Iterator[StepColumns]:
    """Yield the metrics of each series at every step, as per_step.csv has them.

    They are ``rmse`` (hdepf eq. 16), ``bias``, ``std`` (adaptive-kf eqs. 13, 14), other means over the
    runs, and medians of stored series. ``sizes`` has the number of components of each NEES by its
    marginal, a part of the state such as "position", or "" for the whole state.
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
