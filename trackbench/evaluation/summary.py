"""Summarize one filter over all runs: compute the rows of summary.csv and per_step.csv.

The last part computes what each run contributes to a number over steps.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.sums import mean as average
from trackbench.core.sums import total
from trackbench.evaluation.block import Tracks
from trackbench.evaluation.error_series import NOT_LOST, StepSums
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure, measured
from trackbench.evaluation.timing import Measured
from trackbench.metrics import in_window, joined, metric_of, metrics_of
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

    ``sizes`` is the number of components of each NEES by its name, ``windows`` are the masks (T + 1,)
    of the steps. ``time-mean(rmse)`` is the mean over a window's steps of the RMSE over runs. Its
    standard error is computed from the runs' shares if they are stored. Otherwise it is an upper bound,
    the mean of the steps' own standard errors: errors that are correlated in time cannot add up to more.
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
    """Yield the rows of the summary that are m per component, such as ANEES, with the number of these.

    ``m`` is a metric per run, ``sizes`` has the number of components of each NEES. A metric at a step
    has no such row.
    """
    if m.steps is not None:
        return
    quantity = m.quantity
    for metric, name in metrics_of(m.metric):
        if metric.per_component:
            yield in_window(name, m.window), sizes[quantity]


def _time_means(
    result: FilterResult, windows: Mapping[str, Mask], lost: int
) -> Iterator[SummaryRow]:
    """Yield the mean over each window's steps of the RMSE over the runs.

    ``windows`` are masks (T + 1,) by name, and ``lost`` is the number of lost runs, for the rows.
    """
    for series, sums in result.steps.items():
        names = [name for metric, name in metrics_of(series) if metric.name == "rmse"]
        for name in names:
            for window, mask in windows.items():
                valid = mask & (sums.number > 0)
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
    runs, and medians of stored series. ``sizes`` has the number of components of each NEES.
    """
    for name, sums in result.steps.items():
        # A column of zeros, of a NEES or NIS that lacks no component, is left out.
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


def bound_summary(
    bounds: Mapping[str, Array],
    windows: Mapping[str, Mask],
    without: Sequence[Mapping[str, Array]] = (),
) -> Iterator[SummaryRow]:
    """Yield a scenario's lower bounds on every RMSE over each window.

    ``bounds`` are those at every step (T + 1,) by quantity, ``windows`` the masks (T + 1,). The standard
    error is from ``without``, the bounds without one batch of simulated paths each.
    """
    reductions: dict[str, Callable[[Array], Array]] = {"rms": _root_mean_square, TIME_MEAN: average}
    for window, mask in windows.items():
        for quantity, bound in bounds.items():
            metric = in_window(joined("rmse", quantity), window)
            for statistic, over_steps in reductions.items():
                value = float(over_steps(bound[mask]))
                stderr = _jackknife([over_steps(others[quantity][mask]) for others in without])
                # A bound has no runs: both counts are zero.
                yield SummaryRow(
                    f"{statistic}({metric})", value=value, stderr=float(stderr), runs=0, lost=0
                )


def bound_steps(
    bounds: Mapping[str, Array], without: Sequence[Mapping[str, Array]] = ()
) -> Iterator[StepColumns]:
    """Yield a scenario's lower bounds at every step, as `step_columns` has the RMSE.

    ``bounds`` (T + 1,) are by quantity. The standard error is from ``without``, the bounds without one
    batch of simulated paths each.
    """
    for quantity, bound in bounds.items():
        stderr = np.full_like(bound, _jackknife([others[quantity] for others in without]))
        yield StepColumns(
            positions=np.arange(len(bound)),
            metrics={joined("rmse", quantity): Estimates(value=bound, stderr=stderr)},
            runs=np.zeros(len(bound), dtype=int),
        )


def _root_mean_square(x: Array) -> Array:
    return np.sqrt(average(np.square(x)))


def _jackknife(without: Sequence[Array]) -> Array:
    """Return the jackknife's standard error of a value from the B values without one batch each.

    ``sqrt((B - 1) / B sum (b_i - mean b)^2)`` (Efron & Stein 1981). It is NaN if there are no batches.
    """
    B = len(without)
    if not B:
        return np.array(np.nan)
    b = np.array(without)
    return np.sqrt((B - 1) / B * total(np.square(b - average(b, 0)), 0))


def _step_metrics(
    series: str, sums: StepSums, sizes: Mapping[str, int]
) -> Iterator[tuple[str, Estimates]]:
    """Yield the metrics of one series at every step (T + 1,), NaN where no run has a value."""
    # The metric's definition decides: root of a mean square, spread, or mean per component. A metric
    # without a definition over runs has no value at a step.
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


# Contributions of runs: numbers over steps as values per run. Their average is the number, and their
# spread its error.
#
# ``time-mean(rmse)`` averages over steps what was averaged over runs, so that no run has a value of its
# own, and errors of one run are correlated in time. Its linear part gives each run a share (the
# infinitesimal jackknife, Efron 1982, chapter 6): ``value + influence``. ``rmse@20`` and ``std_x@20``
# need each run's error at a step. A share has the name of its expression. It stands in per_run.csv
# where an experiment asks for it.


def series_of(m: Measure) -> str | None:
    """Return the name of the series from which the runs' shares of the measure m are computed.

    A share is what one run contributes to a number over steps. None if the measure has no shares. Two
    forms of expression have them: ``time-mean(rmse_x)``, and a metric at a step, ``rmse_x@20``.
    """
    definition = m.definition
    quantity = m.quantity
    is_at_step = m.steps is not None
    if m.statistic == TIME_MEAN and not is_at_step:
        if definition.name != "rmse":
            return None
        return joined(definition.series, quantity)
    # Any other statistic is computed from one value per run, which is in per_run.csv as it is.
    if m.statistic or not is_at_step:
        return None
    # An efficiency relates two filters.
    if definition.name == "efficiency":
        return None
    if definition.series:
        return joined(definition.series, quantity)
    return m.metric


def statistic_of(m: Measure) -> str | None:
    """Return the statistic over the runs' shares whose value is the measure m; None without shares."""
    if series_of(m) is None:
        return None
    if m.statistic:
        return "mean"
    return m.definition.over_runs or "mean"


def with_shares(
    result: FilterResult,
    wanted: Iterable[Measure],
    windows: Mapping[str, Mask],
    steps: Sequence[int],
    sizes: Mapping[str, int],
) -> FilterResult:
    """Return the result with the runs' shares of each measure in ``wanted``, as a metric per run.

    A measure whose series was not stored is left out. ``windows`` are masks (T + 1,) by name, ``steps``
    the T + 1 numbers of the steps, and ``sizes`` the number of components of each NEES.
    """
    shares: dict[str, Array] = {}
    for m in wanted:
        rows = result.run_series.get(series_of(m) or "")
        if rows is None:
            continue
        share = None
        if m.steps is not None:
            share = _errors_at_step(m, rows, steps, sizes)
        elif m.window in windows:
            not_lost = result.per_run["lost"] == NOT_LOST
            share = time_mean_shares(rows[windows[m.window]], not_lost)
        if share is not None:
            shares[str(m)] = share
    return result._replace(per_run=result.per_run | shares)


def _errors_at_step(
    m: Measure, rows: Array, steps: Sequence[int], sizes: Mapping[str, int]
) -> Array | None:
    """Return the value of the measure m in each run (M,) at its step; None if there is no such step.

    ``rows`` (T + 1, M) is the series, ``steps`` are the T + 1 numbers of the steps. Of a squared error
    the root is returned, of a NEES the value per component.
    """
    assert m.steps is not None
    number = steps[-1] if m.steps.first == "last" else int(m.steps.first)
    if number not in steps:
        return None
    row = rows[steps.index(number)]
    metric = m.definition
    quantity = m.quantity
    if metric.over_runs == "rms":
        return np.sqrt(row)
    if metric.per_component:
        return row / sizes[quantity]
    return row


@np.errstate(all="ignore")
def time_mean_shares(squared: Array, not_lost: Mask) -> Array:
    """Return runs' contributions (M,) to ``mean_k sqrt(mean_m e_km^2)`` from squared errors (K, M).

    If every run has an error at every step, a run's share is
    ``value + 1 / K sum_k (e_km^2 - MSE_k) / (2 RMSE_k)``. A run without an error at a step has no
    influence there, and the others have more. The mean of the shares is the value. Lost runs, whose
    ``not_lost`` (M,) is False, have the share NaN.
    """
    counted = ~np.isnan(squared) & not_lost
    number = counted.sum(axis=1)
    # Leave out the steps at which no run has an error.
    with_error = number > 0
    counted = counted[with_error]
    number = number[with_error]
    squares = np.where(counted, squared[with_error], 0.0)
    # MSE_k and RMSE_k over the runs with an error at step k
    mse = total(squares) / number
    rmse = np.sqrt(mse)
    # d mean_k RMSE_k: sum_k (e_km^2 - MSE_k) M / (2 N_k RMSE_k K) for run m
    K = len(number)
    weight = np.where(rmse > 0.0, not_lost.sum() / (2.0 * number * rmse), 0.0) / K
    influences = np.where(counted, squares - mse[:, None], 0.0) * weight[:, None]
    shares = average(rmse) + total(influences, axis=0)
    return np.where(not_lost & bool(K), shares, np.nan)
