"""Rows of summary.csv: statistics of one filter over all runs."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Mask
from trackbench.core.sums import mean as average
from trackbench.evaluation.lost_runs import NOT_LOST
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure, measured
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.metrics import in_window, metrics_of
from trackbench.statistics.sample_statistics import STATISTICS, mean, mean_from_sums, rooted


class SummaryRow(NamedTuple):
    """A statistic of a metric over the runs that are not lost."""

    metric: str
    value: float
    stderr: float
    runs: int
    lost: int


def summary_rows(
    result: FilterResult, sizes: Mapping[str, int], windows: Mapping[str, Mask]
) -> Iterator[SummaryRow]:
    """Yield the rows of summary.csv: ``mean(rmse)``, ``variance(rmse)``, ``rms(rmse)``, ..., ``anees``.

    ``time-mean(rmse)`` is the mean over a window's steps of the RMSE over runs. Its standard error is
    computed from the runs' shares, the contribution of each run to the time mean, if they are stored.
    Otherwise it is an upper bound, the mean of the steps' own standard errors: errors that are
    correlated in time cannot add up to more.

    Parameters
    ----------
    result
        result of one filter over all runs
    sizes
        number of components of each NEES by its marginal, a part of the state such as "position", or ""
        for the whole state
    windows
        masks (T + 1,) of the steps by name

    Yields
    ------
    SummaryRow
        value and standard error, in the unit of the metric, of ``variance`` in its square
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
    """Yield the rows of the summary that are a metric per component, such as the ANEES.

    Parameters
    ----------
    m
        metric per run. A metric at a step has no such row
    sizes
        number of components of each NEES by its marginal, the part of the state that the NEES is of:
        "position" for `nees_position`, "" for the whole state

    Yields
    ------
    name : str
        name of the row, such as ``anees_position``
    n : int
        number of components
    """
    if m.steps is not None:
        return
    quantity = m.quantity  # of a NEES the marginal
    # `metrics_of` takes the name of a series. Of the series `nees_position` the metrics `nees_position`
    # and `anees_position` are made; the second is per component, and is yielded. A metric per run that
    # is divided by a number of components has the name of its series.
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
                # A run's share is its contribution to the time mean: the mean of the shares is the
                # value, and their spread gives the standard error. Shares are stored on request only;
                # without them the standard error is an upper bound.
                shares = result.per_run.get(row)
                if shares is not None:
                    stderr = mean(shares[~np.isnan(shares)]).stderr
                yield SummaryRow(row, value, stderr, int(sums.number[mask].max()), lost)
