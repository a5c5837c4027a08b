"""Series of a block, a piece of steps at a time, and their sums.

They are summed over the steps of each window for each run, and over the runs at each step.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask, any_nan
from trackbench.core.sums import WindowSums, dot, total
from trackbench.evaluation.anis_and_autocorrelation import innovation_metrics
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.error_series import series as error_series
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.lost_runs import NOT_LOST
from trackbench.evaluation.nees import rank_of
from trackbench.metrics import in_window, metrics_of
from trackbench.models.delays import LATE_COUNTS
from trackbench.scenarios.base import Simulation

_COLUMNS = 16_384  # runs times steps whose series are made and added up at a time, in the cache


class StepSums(NamedTuple):
    """Per step (T + 1,): sum and sum of squares over the runs that are not lost, and their number."""

    total: Array
    squares: Array
    number: Array


class SeriesSums:
    """Sums of series: over the steps of each window for each run, over the runs at each step.

    A series is added in pieces of consecutive steps.
    """

    def __init__(self, windows: Mapping[str, Mask], counts: Collection[str]) -> None:
        """Begin without series.

        ``windows`` are the masks (T + 1,) of the steps by name. ``counts`` names the diagnostics whose
        metric is the sum over the steps, not the mean.
        """
        self._windows = windows
        self._counts = counts
        self._masks = np.stack([*windows.values()])  # (W, T + 1) of all windows
        # By series: how each of its metrics reduces the steps of a window ("mean", "rms", ...).
        self._reductions: dict[str, dict[str, str]] = {}
        # By series and "values" or "roots": sums over windows of its values, or of the roots of its
        # values, which are squared errors then.
        self._window_sums: dict[tuple[str, str], WindowSums] = {}
        # By series: sums over the runs at each step, a piece of consecutive steps after the other.
        self._step_sums: dict[str, list[StepSums]] = {}

    @classmethod
    def from_series(
        cls, values: Mapping[str, Array], windows: Mapping[str, Mask], counts: Collection[str]
    ) -> "SeriesSums":
        """Return the sums of whole series.

        Parameters
        ----------
        values
            series (T + 1, M) by name
        windows
            masks (T + 1,) of the steps by name
        counts
            names of the diagnostics whose metric is the sum over the steps, not the mean

        Returns
        -------
        SeriesSums
            sums of all series
        """
        sums = cls(windows, counts)
        for name, rows in values.items():
            sums.add(name, rows, first=0)
        return sums

    def add(self, series: str, rows: Array, first: int) -> None:
        """Add the values of some consecutive steps to a series.

        Parameters
        ----------
        series
            name of the series
        rows
            values (S, M) of S steps, NaN where a run has none
        first
            index of the first of these steps
        """
        if series not in self._reductions:
            self._reductions[series] = {
                name: metric.over_steps
                for metric, name in metrics_of(series, self._counts)
                if metric.over_steps
            }
        reductions = self._reductions[series].values()
        columns: dict[str, Array] = {}
        # A series without a metric of a run needs no sums over steps.
        if reductions:
            columns["values"] = rows
        if "root" in reductions:
            columns["roots"] = np.sqrt(rows)  # the values are squares
        # NaN is left out of the sums; the infinite NEES of collapsed particles is not.
        for name, column in columns.items():
            if (series, name) not in self._window_sums:
                self._window_sums[series, name] = WindowSums(self._masks, rows.shape[1])
            self._window_sums[series, name].add(column, first)
        # Which runs are lost shows only at the end: here all runs count.
        sums = step_sums(rows, np.full(rows.shape[1], NOT_LOST))
        self._step_sums.setdefault(series, []).append(sums)

    def over_runs(self) -> dict[str, StepSums]:
        """Return the sums over all runs, lost ones included, at each step.

        They have the bits of `step_sums` of all steps.
        """
        # The sum of a piece of one step may be -0.0, where that of several steps is 0.0: adding 0.0
        # makes them equal, so that the size of the pieces changes no bit.
        return {
            name: StepSums(
                total=np.concatenate([sums.total for sums in pieces]) + 0.0,
                squares=np.concatenate([sums.squares for sums in pieces]) + 0.0,
                number=np.concatenate([sums.number for sums in pieces]) + 0.0,
            )
            for name, pieces in self._step_sums.items()
        }

    @np.errstate(all="ignore")  # a run may have no value
    def over_windows(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return each metric of each run over each window.

        The sums over the steps have been collected by `add`.

        Parameters
        ----------
        values
            whole series (T + 1, M) by name

        Returns
        -------
        dict
            metrics (M,) by name, with the window in the name
        """
        by_window: list[dict[str, Array]] = [{} for _ in self._windows]
        last_steps = [np.flatnonzero(mask)[-1] for mask in self._masks]  # index, of each window
        for series, reductions in self._reductions.items():
            if not reductions:
                continue
            # Each way to reduce the steps to one number: arrays (W, M) over the W windows.
            sums = self._window_sums[series, "values"]
            mean = sums.total / sums.number
            reduced = {"sum": sums.total, "mean": mean, "last": values[series][last_steps]}
            if "rms" in reductions.values():
                reduced["rms"] = np.sqrt(mean)  # the values are squares
            if "root" in reductions.values():
                reduced["root"] = self._window_sums[series, "roots"].total / sums.number
            for i, metrics in enumerate(by_window):
                for name, reduction in reductions.items():
                    metrics[name] = reduced[reduction][i]
        named: dict[str, Array] = {}
        for window, metrics, mask in zip(self._windows, by_window, self._masks, strict=True):
            metrics |= innovation_metrics(values, mask)
            for name, numbers in metrics.items():
                named[in_window(name, window)] = numbers
        return named


def step_sums(rows: Array, lost: Array) -> StepSums:
    """Sum the values of a series over the runs that are not lost; NaN is left out.

    Parameters
    ----------
    rows
        values (T + 1, M)
    lost
        key of `LOST_BECAUSE`, or `NOT_LOST`, for each run (M,)

    Returns
    -------
    StepSums
        sums, sums of squares and numbers (T + 1,)
    """
    not_lost = lost == NOT_LOST
    # If every value counts, no copy is needed.
    if not_lost.all() and not any_nan(rows):
        runs = float(rows.shape[1])
        return StepSums(total(rows), dot(rows, rows), np.full(len(rows), runs))
    counted: Mask = not_lost & ~np.isnan(rows)
    counted_rows = np.where(counted, rows, 0.0)
    return StepSums(
        total=total(counted_rows),
        squares=dot(counted_rows, counted_rows),
        number=counted.sum(axis=1).astype(float),
    )


def with_unused(steps: dict[str, StepSums]) -> dict[str, StepSums]:
    """Complete the sums of how many components each NEES or NIS lacks: zeros for one that lacks none.

    A NEES lacks the components that are known exactly, without spread, and a NIS those that are not
    measured or that a gate refused. A block in which nothing is lacking has no ``unused`` series of its
    own, and other blocks may have one. A NEES exists for the whole state and for marginals, a NIS only
    as ``nis``.

    Parameters
    ----------
    steps
        sums by series, such as ``nees_position`` and ``unused_nees_position``

    Returns
    -------
    dict
        copy with a series ``unused_...`` for each NEES and NIS
    """
    completed = dict(steps)
    for name, sums in steps.items():
        if name == "nis" or name.partition("_")[0] == "nees":
            zeros = np.zeros_like(sums.number)
            unused = StepSums(total=zeros, squares=zeros, number=sums.number)
            completed.setdefault(f"unused_{name}", unused)
    return completed


def series_and_sums(
    task: BlockTask,
    data: Simulation,
    output: FilterOutput,
    not_errors: dict[str, Array],
    exact_mean: Array | None,
    twin_mean: Array | None,
) -> tuple[dict[str, Array], SeriesSums]:
    """Return the series of errors and other series, and the sums of all of them.

    The steps are taken in pieces, whose series are added up while they are in the processor's cache.

    Parameters
    ----------
    task
        task of the filter
    data
        truth and measurements of the block
    output
        output of the filter over ``data``
    not_errors
        the filter's diagnostics (T + 1, M) and other series that are no errors, such as the likelihood
        ratio. One of them may give the degrees of freedom of the NEES, for `rank_of`
    exact_mean
        estimates (n_x, T + 1, M) of the reference; None if there is none
    twin_mean
        estimates (n_x, T + 1, M) of the same filter without faults; None if the scenario has none

    Returns
    -------
    values : dict
        series (T + 1, M) by name
    sums : SeriesSums
        sums of all series over the windows of steps and over the runs
    """
    values: dict[str, Array] = {}
    # Series that exist already for all steps.
    whole = {"nees": output.nees} | not_errors
    # Series that are summed over the steps, not averaged: the filter's own, and the numbers of
    # measurements that arrive late and that are dropped.
    counts = task.filter.summed_diagnostics | LATE_COUNTS
    sums = SeriesSums(task.scenario.windows, counts)
    steps, runs = output.nees.shape
    at_a_time = max(1, _COLUMNS // runs)
    rank = rank_of("nees", not_errors, len(data.truth))

    for first in range(0, steps, at_a_time):
        piece = slice(first, first + at_a_time)
        rows_by_name = error_series(
            task.scenario,
            truth=data.truth[:, piece],
            mean=output.mean[:, piece],
            nees=output.nees[piece],
            exact=_steps_of_mean(exact_mean, piece),
            rank=None if rank is None else rank[piece],
            twin=_steps_of_mean(twin_mean, piece),
        )
        for name, rows in not_errors.items():
            rows_by_name[name] = rows[piece]
        for name, rows in rows_by_name.items():
            if name in whole:
                values[name] = whole[name]
            else:
                if name not in values:
                    values[name] = np.empty((steps, runs))
                values[name][piece] = rows
            sums.add(name, rows, first)
    return values, sums


def _steps_of_mean(mean: Array | None, piece: slice) -> Array | None:
    """Return some steps of a mean (n_x, T + 1, M), if there is one."""
    if mean is None:
        return None
    return mean[:, piece]
