"""Rows of the result tables from one filter's merged results."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.metrics import FOUND, joined
from trackbench.evaluation.statistics import (
    STATISTICS,
    Estimate,
    mean,
    mean_from_sums,
    median,
    root,
)


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


def summary_rows(result: FilterResult, n_x: int) -> Iterator[SummaryRow]:
    """``mean(rmse)``, ``variance(rmse)``, ``rms(rmse)``, ``median(rmse)``, ..., and ``anees``."""
    lost = int((result.per_run["lost"] != FOUND).sum())
    for metric, values in result.per_run.items():
        if metric == "lost":
            continue
        found = values[~np.isnan(values)]
        for name, statistic in STATISTICS.items():
            yield SummaryRow(f"{name}({metric})", *statistic(found), len(found), lost)
        if metric.partition("[")[0] == "nees":
            value, stderr = mean(found)
            suffix = metric[len("nees") :]
            yield SummaryRow(f"anees{suffix}", value / n_x, stderr / n_x, len(found), lost)


def step_rows(result: FilterResult, n_x: int) -> Iterator[StepRow]:
    """``rmse`` (hdepf eq. 16), ``bias`` and ``std`` (adaptive-kf eqs. 13, 14), means of the rest."""
    for name, (total, squares, number) in result.steps.items():
        head, _, quantity = name.partition("_")
        for i, (t, s, c) in enumerate(zip(total, squares, number, strict=True)):
            if c == 0:
                continue
            average = mean_from_sums(t, s, c)
            for metric, estimate in _step_metrics(head, quantity, name, average, t, s, c, n_x):
                yield StepRow(i, metric, *estimate, int(c))
    for name, rows in result.kept.items():
        for i, row in enumerate(_found(rows)):
            if len(row):
                yield StepRow(i, f"median({name})", *median(row), len(row))


def _step_metrics(
    head: str, quantity: str, name: str, average: Estimate, t: float, s: float, c: float, n_x: int
) -> Iterator[tuple[str, Estimate]]:
    if head in ("squared", "distance"):
        metric = "rmse" if head == "squared" else "distance"
        yield joined(metric, quantity), root(average)
    elif head == "error":
        yield joined("bias", quantity), average
        std = float(np.sqrt(max(s / c - (t / c) ** 2, 0.0)))
        yield joined("std", quantity), Estimate(std, std / np.sqrt(2.0 * c))
    elif name == "nees":
        yield "anees", Estimate(average.value / n_x, average.stderr / n_x)
    else:
        yield name, average


def _found(rows: Array) -> list[Array]:
    return [row[~np.isnan(row)] for row in rows]
