"""Rows of the result tables from one filter's merged results."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import mean as average
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.metrics import FOUND, StepSums, joined
from trackbench.evaluation.shares import TIME_MEAN
from trackbench.evaluation.statistics import (
    STATISTICS,
    Estimates,
    mean,
    mean_from_sums,
    median,
    rooted,
)
from trackbench.scenarios.base import in_window


class SummaryRow(NamedTuple):
    """A statistic of a metric over the runs that are not lost."""

    metric: str
    value: float
    stderr: float
    runs: int
    lost: int


class StepRow(NamedTuple):
    """A metric at one step over the runs that are not lost."""

    position: int
    metric: str
    value: float
    stderr: float
    runs: int


def summary_rows(
    result: FilterResult, sizes: Mapping[str, int], windows: Mapping[str, Mask]
) -> Iterator[SummaryRow]:
    """``mean(rmse)``, ``variance(rmse)``, ``rms(rmse)``, ``median(rmse)``, ..., and ``anees``.

    ``sizes`` is the number of components by the name of each NEES. ``time-mean(rmse)`` is the mean over
    a window's steps of the RMSE over runs. Its standard error is that of the runs' shares, where there
    are any; where nothing asks for it, no more than an upper bound is given, the mean of the steps' own,
    because errors that are correlated in time cannot add up to more.
    """
    lost = int((result.per_run["lost"] != FOUND).sum())
    for metric, values in result.per_run.items():
        found = values[~np.isnan(values)]
        share = TIME_MEAN.fullmatch(metric)
        if share and not share.group(3) and not result.steps:  # read back: it is all that is known
            yield SummaryRow(metric, *mean(found), len(found), lost)
        if share or metric == "lost":
            continue
        for name, statistic in STATISTICS.items():
            yield SummaryRow(f"{name}({metric})", *statistic(found), len(found), lost)
        head, _, part = metric.partition("[")[0].partition("_")
        if head == "nees":
            value, stderr = mean(found)
            n = sizes[part]
            yield SummaryRow(f"a{metric}", value / n, stderr / n, len(found), lost)
    yield from _time_means(result, windows, lost)


def _time_means(
    result: FilterResult, windows: Mapping[str, Mask], lost: int
) -> Iterator[SummaryRow]:
    for name, (total, squares, number) in result.steps.items():
        head, _, quantity = name.partition("_")
        if head != "squared":
            continue
        for window, mask in windows.items():
            there = mask & (number > 0)
            if there.any():
                metric = f"time-mean({in_window(joined('rmse', quantity), window)})"
                steps = rooted(mean_from_sums(total[there], squares[there], number[there]))
                value, stderr = average(np.stack(steps)).tolist()
                shares = result.per_run.get(metric)
                if shares is not None:
                    stderr = mean(shares[~np.isnan(shares)]).stderr
                yield SummaryRow(metric, value, stderr, int(number[mask].max()), lost)


def step_rows(result: FilterResult, sizes: Mapping[str, int]) -> Iterator[StepRow]:
    """``rmse`` (hdepf eq. 16), ``bias`` and ``std`` (adaptive-kf eqs. 13, 14), means of the rest."""
    for name, sums in result.steps.items():
        there = np.flatnonzero(sums.number)
        columns = [
            (metric, found.value[there].tolist(), found.stderr[there].tolist())
            for metric, found in _step_metrics(name, sums, sizes)
        ]
        numbers = sums.number[there].tolist()
        for j, i in enumerate(there.tolist()):
            for metric, value, stderr in columns:
                yield StepRow(i, metric, value[j], stderr[j], int(numbers[j]))
    for name, rows in result.kept.items():
        for i, row in enumerate(_found(rows)):
            if len(row):
                yield StepRow(i, f"median({name})", *median(row), len(row))


def bound_summary(bounds: Mapping[str, Array], windows: Mapping[str, Mask]) -> Iterator[SummaryRow]:
    """A scenario's lower bounds on every RMSE (T + 1,), over each window as `summary_rows` has them."""
    for window, mask in windows.items():
        for quantity, bound in bounds.items():
            metric = in_window(joined("rmse", quantity), window)
            rms = float(np.sqrt(average(np.square(bound[mask]))))
            yield SummaryRow(f"rms({metric})", rms, float("nan"), 0, 0)
            yield SummaryRow(
                f"time-mean({metric})", float(average(bound[mask])), float("nan"), 0, 0
            )


def bound_steps(bounds: Mapping[str, Array]) -> Iterator[StepRow]:
    """A scenario's lower bounds at every step, as `step_rows` has the RMSE."""
    for quantity, bound in bounds.items():
        for i, value in enumerate(bound.tolist()):
            yield StepRow(i, joined("rmse", quantity), value, float("nan"), 0)


def _step_metrics(
    name: str, sums: StepSums, sizes: Mapping[str, int]
) -> Iterator[tuple[str, Estimates]]:
    """The metrics of one series at every step (T + 1,), NaN where no run has a value."""
    head, _, quantity = name.partition("_")
    average = mean_from_sums(*sums)
    if head in ("squared", "distance"):
        metric = "rmse" if head == "squared" else "distance"
        yield joined(metric, quantity), rooted(average)
    elif head == "error":
        yield joined("bias", quantity), average
        yield joined("std", quantity), _spread(*sums)
    elif head == "nees":
        n = sizes[quantity]
        yield f"a{name}", Estimates(average.value / n, average.stderr / n)
    else:
        yield name, average


def _spread(total: Array, squares: Array, number: Array) -> Estimates:
    """Standard deviations over runs; their standard errors as of normal values."""
    with np.errstate(all="ignore"):
        std = np.sqrt(np.maximum(squares / number - np.square(total / number), 0.0))
        return Estimates(std, std / np.sqrt(2.0 * number))


def _found(rows: Array) -> list[Array]:
    return [row[~np.isnan(row)] for row in rows]
