"""Contributions of runs: numbers over steps as values per run.

Their average is the number, and their spread its error. ``time-mean(rmse)`` averages over steps what
was averaged over runs, so that no run has a value of its own, and errors of one run are correlated in
time. Its linear part gives each run a share (the infinitesimal jackknife, Efron 1982, chapter 6):
``value + influence``. ``rmse@20`` and ``std_x@20`` need each run's error at a step. A share has the
name of its expression. It stands in per_run.csv where an experiment asks for it.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import mean as average
from trackbench.core.sums import total
from trackbench.evaluation.lost_runs import NOT_LOST
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.metrics import joined


def series_of(m: Measure) -> str | None:
    """Return the name of the series from which the runs' shares of a measure are computed.

    A share is what one run contributes to a number over steps. Two forms of expression have shares:
    ``time-mean(rmse_x)``, and a metric at a step, ``rmse_x@20``. The series of a diagnostic has the
    diagnostic's own name, without the step.

    Parameters
    ----------
    m
        measure, with or without a filter

    Returns
    -------
    str or None
        name of the series, such as ``squared_x``; None if the measure has no shares
    """
    definition = m.definition
    quantity = m.quantity
    is_at_step = m.steps is not None
    if m.statistic == TIME_MEAN and not is_at_step:
        # Only the RMSE has a time mean: its root is taken at each step, after the mean over the runs.
        if definition.name != "rmse":
            return None
        return joined(definition.series, quantity)
    # Any other statistic is computed from one value per run, which is in per_run.csv as it is.
    if m.statistic or not is_at_step:
        return None
    # An efficiency is the ratio of two RMSEs, that of the reference and that of the filter: no series
    # has it.
    if definition.name == "efficiency":
        return None
    if definition.series:
        return joined(definition.series, quantity)
    return m.metric


def statistic_of(m: Measure) -> str | None:
    """Return the statistic over the runs' shares whose value is a measure.

    A share is what one run contributes to a number over steps.

    Parameters
    ----------
    m
        measure, with or without a filter

    Returns
    -------
    str or None
        ``mean``, ``rms`` or ``std``; None if the measure has no shares
    """
    if series_of(m) is None:
        return None
    # The only statistic with shares is `time-mean`: their mean is the number.
    if m.statistic:
        return "mean"
    # A metric at a step: `rmse@20` is the rms of the runs' errors, `std_x@20` their standard deviation,
    # `anees@20` and metrics without a declared statistic the mean.
    return m.definition.over_runs or "mean"


def with_shares(
    result: FilterResult,
    wanted: Iterable[Measure],
    windows: Mapping[str, Mask],
    steps: Sequence[int],
    sizes: Mapping[str, int],
) -> FilterResult:
    """Return the result with the runs' shares of some measures, as metrics per run.

    A share (M,) is what each run contributes to a number over steps, such as ``time-mean(rmse)``: the
    mean over the runs is the number. The metric has the name of the expression.

    Parameters
    ----------
    result
        result of one filter over all runs
    wanted
        measures. One whose series was not stored is left out
    windows
        masks (T + 1,) of the steps by name
    steps
        numbers of the T + 1 steps
    sizes
        number of components of each NEES by its marginal, a part of the state such as "position", or ""
        for the whole state

    Returns
    -------
    FilterResult
        copy with more metrics per run (M,)
    """
    shares: dict[str, Array] = {}
    for m in wanted:
        rows = result.run_series.get(series_of(m) or "")
        if rows is None:
            continue
        share = None
        if m.steps is not None:
            share = _values_at_step(m, rows, steps, sizes)
        elif m.window in windows:
            not_lost = result.per_run["lost"] == NOT_LOST
            share = time_mean_shares(rows[windows[m.window]], not_lost)
        if share is not None:
            shares[str(m)] = share
    return result._replace(per_run=result.per_run | shares)


def _values_at_step(
    m: Measure, rows: Array, steps: Sequence[int], sizes: Mapping[str, int]
) -> Array | None:
    """Return the value of the measure m in each run (M,) at its step; None if the run has no such step.

    ``rows`` (T + 1, M) is the series that the measure is computed from, ``steps`` are the T + 1 numbers
    of the steps. ``sizes`` has the number of components of each NEES by the quantity, a part of the
    state such as "position", or "" for the whole state. Of a squared error the root is returned, of a
    NEES the value per component.
    """
    assert m.steps is not None
    # ``first`` is a number as text, or the word `last`.
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
    """Return the runs' contributions to ``mean_k sqrt(mean_m e_km^2)``.

    If every run has an error at every step, a run's share is
    ``value + 1 / K sum_k (e_km^2 - MSE_k) / (2 RMSE_k)``. A run without an error at a step has no
    influence there, and the others have more. The mean of the shares is the value.

    Parameters
    ----------
    squared
        squared errors (K, M) at K steps, NaN where a run has none
    not_lost
        mask (M,) of the runs that are not lost

    Returns
    -------
    array (M,)
        shares, in the unit of the error; NaN for lost runs, and for all if no run has an error
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
