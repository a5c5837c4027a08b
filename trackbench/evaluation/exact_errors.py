"""Exact mean square errors of linear filters, computed without Monte Carlo runs.

If estimates are affine in the normal variates w of a run, every squared error q(w) is quadratic, and its
mean follows from the values at the unit vectors u_j::

    E q(w) = q(0) + sum_j [ (q(u_j) + q(-u_j)) / 2 - q(0) ]

q(0) is the squared bias, and the sum is the trace of the errors' covariance (Kurt & Orguner 2025, arXiv
2511.22034). Scenario and filter are run as they are, on streams that return these vectors.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from math import prod
from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.random_streams import RunStreams
from trackbench.core.read_only import freeze
from trackbench.core.sums import total
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.error_series import series
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure, measured
from trackbench.evaluation.nees import rank_of
from trackbench.evaluation.per_run_metrics import over_windows
from trackbench.evaluation.per_step_columns import StepColumns, step_columns
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.series_sums import StepSums
from trackbench.evaluation.summary_rows import SummaryRow, summary_rows
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.scenarios.base import Simulation
from trackbench.statistics.sample_statistics import Estimates

_QUADRATIC = ("squared", "error", "nees", "nis")  # series of degree two at most in the errors
_UNITS = 256  # unit vectors that are filtered together


class _FixedNormals:
    """Streams of fixed normal variates: ``variates`` returns the rows j (J, M) of all runs."""

    def __init__(self, variates: Callable[[Index], Array]) -> None:
        self._variates = variates
        self.drawn = 0
        """number of rows drawn so far"""

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return the next rows of the variates in this shape, whose last axis is that of the runs."""
        rows = np.arange(self.drawn, self.drawn + prod(size[:-1]))
        self.drawn += len(rows)
        return self._variates(rows).reshape(size)

    def random(self, *size: object) -> Array:
        """Reject uniform and gamma variates."""
        raise NotImplementedError

    # The other methods by which a scenario draws from its streams.
    standard_gamma = beside = random


def _run_with_streams(
    task: BlockTask, streams: _FixedNormals, runs: int
) -> tuple[Simulation, FilterOutput]:
    """Simulate and filter ``runs`` runs of the task's scenario, with the noise of these streams.

    They replace the runs of the task's block: ``width`` is the number of runs that are filtered, and
    ``runs_used`` that of the first runs among them that are reported, here all.
    """
    data = freeze(task.scenario.simulate(cast(RunStreams, streams), runs))
    return data, run_filter(replace(task, width=runs, runs_used=runs), data)


@lru_cache(maxsize=64)
@np.errstate(all="ignore")
def why_not_exact(task: BlockTask) -> str | None:
    """Explain why a filter has no exact errors.

    Filter and scenario are linear if states, measurements and estimates are affine in the noise w:
    f(a + b) + f(0) = f(a) + f(b). This is tried with two vectors a and b, in four runs.

    Parameters
    ----------
    task
        task of the filter

    Returns
    -------
    str or None
        reason, and where possible what to do; None if the filter has exact errors
    """
    tracker = task.filter
    # A gate or a robust update depends on the innovation, so that the estimate is not affine in it.
    adapts = isinstance(tracker, GaussianFilter) and (tracker.gate or tracker.robust)
    if not tracker.is_linear or adapts:
        message = f"`{tracker.kind}` is not linear"
        return f"{message}; take a `kf` without `gate` and `robust`, or an `alpha-beta`"
    if task.scenario.recorded_runs is not None:
        return "the measurements are recorded: nothing of them is random"
    try:
        # Four runs, with the noise 0, a, b and a + b.
        data, output = _run_with_streams(task, _FixedNormals(_dense), 4)
    except NotImplementedError:  # `_FixedNormals` has no other variates than normal ones
        message = (
            "its scenario draws more than normal noise: `detection`, `outliers`, a random `delay`"
        )
        return f"{message}, a random path"
    if not np.isfinite(output.mean).all():
        return "its estimates leave the numbers"
    numbers = {"states": data.truth, "measurements": data.measurements, "estimates": output.mean}
    for name, values in numbers.items():
        if not _is_affine(values):
            return f"{name} are not linear in the noise of motion and sensor"
    return None


def _dense(rows: Index) -> Array:
    """Return four vectors (J, 4) of the rows of noise: zeros, a, b and a + b, with arbitrary a and b."""
    a = (37 * rows % 11 - 5) / 3.0
    b = (23 * rows % 7 - 3) / 2.0
    return np.stack([np.zeros(len(rows)), a, b, a + b], axis=1)


def _is_affine(x: Array) -> bool:
    """Test whether a function f is affine, so that f(a + b) + f(0) = f(a) + f(b).

    ``x`` (..., 4) are its values at 0, a, b and a + b. Components without any value are left out.
    """
    known = x[~np.isnan(x).all(axis=-1)]
    difference = known[..., 3] + known[..., 0] - known[..., 1] - known[..., 2]
    # More than 1e-9 of the largest value is no rounding error.
    return bool(np.all(np.abs(difference) <= 1e-9 * np.abs(known).max(initial=0.0)))


@np.errstate(all="ignore")
def exact_series(task: BlockTask) -> dict[str, Array]:
    """Return the mean over all possible runs of each quadratic series.

    Scenario and filter must be linear (`why_not_exact`), so that errors are affine in the independent
    standard normal variates u of a run. Series such as ``squared``, ``error`` and ``nees`` are then
    quadratic functions q(u).

    Parameters
    ----------
    task
        task of the filter

    Returns
    -------
    dict
        means (T + 1,) by the name of the series
    """
    means: dict[str, Array] = {}
    first = 0
    drawn = 1  # rows of noise that a run draws: unknown before the first pass
    while first < drawn:
        # Step 1: filter no noise (u = 0), each unit vector u_j and its negative.
        streams = _unit_vectors(first)
        runs = 1 + 2 * _UNITS
        data, output = _run_with_streams(task, streams, runs)
        drawn = streams.drawn
        values = series(
            task.scenario,
            truth=data.truth,
            mean=output.mean,
            nees=output.nees,
            exact=None,  # no reference filter
            rank=rank_of("nees", output.diagnostics, len(data.truth)),
        )
        # Step 2: E q = q(0) + sum_j [ (q(u_j) + q(-u_j)) / 2 - q(0) ]
        # Run 0 has u = 0, the runs 1, 3, ... have a u_j each, and the runs 2, 4, ... its negative. The
        # u_j beyond the last row of noise change nothing: their terms are zero.
        for name, q in (values | output.diagnostics).items():
            if name.partition("_")[0] not in _QUADRATIC:
                continue
            at_zero = q[:, :1]
            at_unit = q[:, 1::2]
            at_negative = q[:, 2::2]
            if name not in means:
                means[name] = at_zero[:, 0].copy()
            means[name] += total(0.5 * (at_unit + at_negative) - at_zero)
        first += _UNITS
    return means


def _unit_vectors(first: int) -> _FixedNormals:
    """Return streams whose noise is zero in run 0, and a unit vector or its negative in the other runs.

    Run 1 has u_first and run 2 its negative, runs 3 and 4 have those of the next unit vector, and so
    on. The unit vector u_j is 1 in row j of the noise.
    """
    # -1 is no row: run 0 has no noise.
    row_of_run = np.append(-1, np.arange(first, first + _UNITS).repeat(2))
    value_of_run = np.array([0.0, *([1.0, -1.0] * _UNITS)])
    return _FixedNormals(lambda rows: np.where(rows[:, None] == row_of_run, value_of_run, 0.0))


def exact_rows(
    means: Mapping[str, Array], sizes: Mapping[str, int], windows: Mapping[str, Mask]
) -> tuple[list[SummaryRow], list[StepColumns]]:
    """Return the rows of the summary and of every step that follow from exact means of series.

    Parameters
    ----------
    means
        means (T + 1,) over all possible runs, by series, as `exact_series` returns them
    sizes
        number of components of each NEES by its marginal, a part of the state such as "position", or ""
        for the whole state
    windows
        masks (T + 1,) of the steps by name

    Returns
    -------
    rows : list of SummaryRow
        rows of summary.csv, without standard errors (NaN) and with 0 runs
    columns : list of StepColumns
        columns of per_step.csv, without standard errors (NaN) and with 0 runs
    """
    # The means stand for the values of one run.
    one_run = {name: values[:, None] for name, values in means.items()}
    per_run = {"lost": np.zeros(1)} | over_windows(one_run, windows, ())
    steps = {}
    for name, values in means.items():
        # Sums over two runs that are both the mean: a standard deviation needs two. The mean square of a
        # signed error gives its standard deviation: that of `error_x` is `squared_x`. No standard
        # deviation of another series is shown, so that any number may stand for its mean square. Steps
        # without a value have the number 0 and are not shown.
        squares = means.get(name.replace("error", "squared", 1), values)
        known = ~np.isnan(values)
        steps[name] = StepSums(
            total=2.0 * np.where(known, values, 0.0), squares=2.0 * squares, number=2.0 * known
        )
    result = FilterResult(per_run=per_run, steps=steps, run_series={}, tracks=None, timing=[])
    rows = []
    for row in summary_rows(result, sizes, windows):
        if is_exact(measured(row.metric)):
            rows.append(row._replace(stderr=np.nan, runs=0))
    columns_of_steps = [_without_runs(columns) for columns in step_columns(result, sizes)]
    return rows, columns_of_steps


def is_exact(m: Measure) -> bool:
    """Test whether a measure follows from exact mean squares, unlike ``mean(rmse)``, a mean of roots.

    Parameters
    ----------
    m
        measure, with or without a filter

    Returns
    -------
    bool
        True if its series is quadratic in the errors, and its statistic over the runs is that over the
        steps
    """
    metric = m.definition
    # A diagnostic such as `nis` is a series of its own.
    is_quadratic = (metric.series or metric.name) in _QUADRATIC
    # The same statistic over runs and over steps is that of all values: rms(rmse), mean(nees).
    return is_quadratic and m.statistic in ("", TIME_MEAN, metric.over_steps)


def _without_runs(columns: StepColumns) -> StepColumns:
    """Return the columns of exact numbers, with NaN for standard errors and 0 for runs."""
    metrics = {}
    for name, estimates in columns.metrics.items():
        unknown = np.full_like(estimates.stderr, np.nan)
        metrics[name] = Estimates(value=estimates.value, stderr=unknown)
    return columns._replace(metrics=metrics, runs=np.zeros_like(columns.runs))
