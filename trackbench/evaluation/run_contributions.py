"""Numbers over steps as values per run, whose average is the number and whose spread its error.

``time-mean(rmse)`` averages over steps what was averaged over runs, so that no run has a value of its
own, and errors of one run are correlated in time. Its linear part gives each run a share (the
infinitesimal jackknife, Efron 1982, chapter 6): ``value + influence``. ``rmse@20`` and ``std_x@20``
need each run's error at a step. A share has the name of its expression, and stands in per_run.csv where
an experiment asks for it.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import mean, total
from trackbench.evaluation.error_series import FOUND
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure
from trackbench.evaluation.summary import FilterResult
from trackbench.metrics import joined


def series_of(m: Measure) -> str | None:
    """Name of the series that a share of this measure is made of; None if it has no shares."""
    found, quantity = m.family
    if m.statistic == TIME_MEAN and not m.steps:
        return joined(found.series, quantity) if found.name == "rmse" else None
    if m.statistic or not m.steps or found.name == "efficiency":
        return None
    return joined(found.series, quantity) if found.series else m.metric


def statistic_of(m: Measure) -> str | None:
    """Return the statistic over runs of its shares that a measure is; None if it has no shares."""
    if series_of(m) is None:
        return None
    return "mean" if m.statistic else m.family[0].over_runs or "mean"


def with_shares(
    result: FilterResult,
    wanted: Iterable[Measure],
    windows: Mapping[str, Mask],
    steps: Sequence[int],
    sizes: Mapping[str, int],
) -> FilterResult:
    """Return the result with a metric per run for each measure whose series was kept.

    ``windows`` are masks (T + 1,) by name, ``steps`` the T + 1 numbers of the steps, ``sizes`` how
    many components each NEES has.
    """
    shares = {}
    for m in wanted:
        rows = result.run_series.get(series_of(m) or "")
        if rows is not None:
            shares[str(m)] = _share(m, rows, result, windows, steps, sizes)
    there = {name: values for name, values in shares.items() if values is not None}
    return result._replace(per_run=result.per_run | there)


def _share(
    m: Measure,
    rows: Array,
    result: FilterResult,
    windows: Mapping[str, Mask],
    steps: Sequence[int],
    sizes: Mapping[str, int],
) -> Array | None:
    if m.steps is None:
        # A time mean: each run's share of it, over the window's steps.
        mask = windows.get(m.window)
        found = result.per_run["lost"] == FOUND
        return None if mask is None else time_mean_shares(rows[mask], found)
    # At a step: each run's error there; a squared one is rooted.
    number = steps[-1] if m.steps.first == "last" else int(m.steps.first)
    if number not in steps:
        return None
    row, (metric, quantity) = rows[steps.index(number)], m.family
    if metric.over_runs == "rms":
        return np.sqrt(row)
    return row / sizes[quantity] if metric.per_component else row


@np.errstate(all="ignore")
def time_mean_shares(squared: Array, found: Mask) -> Array:
    """Return runs' contributions (M,) to ``mean_k sqrt(mean_m e_km^2)`` from squared errors (K, M).

    A run's share is ``value + 1 / K sum_k (e_km^2 - MSE_k) / (2 RMSE_k)``: their mean is the value. Runs
    that are not ``found`` (M,) have none; a run without an error at a step has no influence there.
    """
    there = ~np.isnan(squared) & found
    number = there.sum(axis=1)
    # Leave out the steps at which no run has an error.
    kept = number > 0
    there, number = there[kept], number[kept]
    squares = np.where(there, squared[kept], 0.0)
    # MSE_k and RMSE_k over the runs with an error at step k
    mse = total(squares) / number
    rmse = np.sqrt(mse)
    # d mean_k RMSE_k: sum_k (e_km^2 - MSE_k) M / (2 N_k RMSE_k K) for run m
    weight = np.where(rmse > 0.0, found.sum() / (2.0 * number * rmse), 0.0) / len(number)
    influences = np.where(there, squares - mse[:, None], 0.0) * weight[:, None]
    return np.where(found & bool(len(number)), mean(rmse) + total(influences, axis=0), np.nan)
