"""Numbers over steps as values per run, whose average is the number and whose spread its error.

``time-mean(rmse)`` averages over steps what was averaged over runs, so that no run has a value of its
own, and errors of one run are correlated in time. Its linear part gives each run a share (the
infinitesimal jackknife, Efron 1982, chapter 6): ``value + influence``. ``rmse@20`` and ``std_x@20``
need each run's error at a step. A share has the name of its expression, and stands in per_run.csv where
an experiment asks for it; ``time-mean(rmse)/4`` are shares of the averages of four batches, each of its
own.
"""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.sums import mean, total
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.metrics import FOUND, joined

TIME_MEAN = re.compile(r"time-mean\(([\w.-]+)(?:\[([^\]]+)\])?\)(?:/(\d+))?")
_STEP = re.compile(r"([\w.-]+)@(\d+|last)")
_SERIES = {
    "rmse": "squared",
    "distance": "distance",
    "bias": "error",
    "std": "error",
    "anees": "nees",
}
_STATISTICS = {"rmse": "rms", "distance": "rms", "std": "std"}


def series_of(expression: str) -> str | None:
    """Name of the series that a share of this expression is made of; None if it has no shares."""
    found = TIME_MEAN.fullmatch(expression) or _STEP.fullmatch(expression)
    if found is None:
        return None
    head, _, quantity = found.group(1).partition("_")
    if head != "rmse" and TIME_MEAN.fullmatch(expression):
        return None
    return joined(_SERIES[head], quantity) if head in _SERIES else found.group(1)


def statistic_of(expression: str) -> str | None:
    """The statistic over runs of its shares that an expression is; None if it has no shares."""
    if series_of(expression) is None:
        return None
    at_step = _STEP.fullmatch(expression)
    return _STATISTICS.get(at_step.group(1).partition("_")[0], "mean") if at_step else "mean"


def with_shares(
    result: FilterResult,
    expressions: Iterable[str],
    windows: Mapping[str, Mask],
    steps: Sequence[int],
    sizes: Mapping[str, int],
    batches: int = 1,
) -> FilterResult:
    """The result with a metric per run for each expression whose series was kept.

    ``windows`` are masks (T + 1,) by name, ``steps`` the T + 1 numbers of the steps, ``sizes`` how
    many components each NEES has. With ``batches``, averages over time have shares in each of them, too.
    """
    wanted = list(expressions)
    if batches > 1:
        wanted += [in_batches(name, batches) for name in wanted if TIME_MEAN.fullmatch(name)]
    shares = {}
    for expression in wanted:
        rows = result.kept.get(series_of(expression) or "")
        if rows is not None:
            shares[expression] = _share(expression, rows, result, windows, steps, sizes)
    there = {name: values for name, values in shares.items() if values is not None}
    return result._replace(per_run=result.per_run | there)


def _share(
    expression: str,
    rows: Array,
    result: FilterResult,
    windows: Mapping[str, Mask],
    steps: Sequence[int],
    sizes: Mapping[str, int],
) -> Array | None:
    mean_over = TIME_MEAN.fullmatch(expression)
    if mean_over:
        mask = windows.get(mean_over.group(2) or "")
        found = result.per_run["lost"] == FOUND
        number = int(mean_over.group(3) or 1)
        return None if mask is None else _shares_of_batches(rows[mask], found, number)
    metric, _, step = expression.partition("@")
    number = steps[-1] if step == "last" else int(step)
    if number not in steps:
        return None
    row, (head, _, part) = rows[steps.index(number)], metric.partition("_")
    if _STATISTICS.get(head) == "rms":
        return np.sqrt(row)
    return row / sizes[part] if head == "anees" else row


def in_batches(expression: str, number: int) -> str:
    """Name of the shares that an expression has in each of so many batches of the runs."""
    return f"{expression}/{number}" if TIME_MEAN.fullmatch(expression) else expression


def batch_of(runs: int, number: int) -> Index:
    """The batch (M,) that each run is in: consecutive runs, as many in each as can be."""
    return np.asarray(np.arange(runs) * number // max(runs, 1))


def _shares_of_batches(squared: Array, found: Mask, number: int) -> Array:
    batch = batch_of(len(found), number)
    shares = [time_mean_shares(squared[:, batch == i], found[batch == i]) for i in range(number)]
    return np.concatenate(shares)


@np.errstate(all="ignore")
def time_mean_shares(squared: Array, found: Mask) -> Array:
    """Shares (M,) of ``mean_k sqrt(mean_m e_km^2)`` from squared errors (K, M), NaN where there is none.

    A run's share is ``value + 1 / K sum_k (e_km^2 - MSE_k) / (2 RMSE_k)``: their mean is the value. Runs
    that are not ``found`` (M,) have none; a run without an error at a step has no influence there.
    """
    there = ~np.isnan(squared) & found
    number = there.sum(axis=1)
    kept = number > 0
    there, number = there[kept], number[kept]
    squares = np.where(there, squared[kept], 0.0)
    mse = total(squares) / number
    rmse = np.sqrt(mse)
    weight = np.where(rmse > 0.0, found.sum() / (2.0 * number * rmse), 0.0) / len(number)
    influences = np.where(there, squares - mse[:, None], 0.0) * weight[:, None]
    return np.where(found & bool(len(number)), mean(rmse) + total(influences, axis=0), np.nan)
