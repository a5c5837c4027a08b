"""Rows of a scenario's lower bounds in summary.csv and per_step.csv."""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import mean as average
from trackbench.evaluation.metric_expression import TIME_MEAN
from trackbench.evaluation.per_step_columns import StepColumns
from trackbench.evaluation.summary_rows import SummaryRow
from trackbench.metrics import in_window, joined
from trackbench.statistics.jackknife import jackknife_stderr
from trackbench.statistics.sample_statistics import Estimates


def bound_summary(
    bounds: Mapping[str, Array],
    windows: Mapping[str, Mask],
    without: Sequence[Mapping[str, Array]] = (),
) -> Iterator[SummaryRow]:
    """Yield a scenario's lower bounds on every RMSE over each window.

    Parameters
    ----------
    bounds
        bounds (T + 1,) at every step by quantity, in the unit of the quantity
    windows
        masks (T + 1,) of the steps by name
    without
        for each batch of simulated paths the bounds from all other batches: their jackknife gives the
        standard error. Empty for a bound without an error

    Yields
    ------
    SummaryRow
        root mean square and mean of a bound over the steps of a window; the numbers of runs are zero
    """
    # Two numbers of each window: the root mean square and the mean of the bound over its steps.
    reductions: dict[str, Callable[[Array], Array]] = {"rms": _root_mean_square, TIME_MEAN: average}
    for window, mask in windows.items():
        for quantity, bound in bounds.items():
            metric = in_window(joined("rmse", quantity), window)
            for statistic, over_steps in reductions.items():
                value = float(over_steps(bound[mask]))
                stderr = jackknife_stderr(
                    [over_steps(others[quantity][mask]) for others in without]
                )
                # A bound has no runs: both counts are zero.
                yield SummaryRow(
                    f"{statistic}({metric})", value=value, stderr=float(stderr), runs=0, lost=0
                )


def bound_steps(
    bounds: Mapping[str, Array], without: Sequence[Mapping[str, Array]] = ()
) -> Iterator[StepColumns]:
    """Yield a scenario's lower bounds at every step, as `step_columns` has the RMSE.

    Parameters
    ----------
    bounds
        bounds (T + 1,) at every step by quantity, in the unit of the quantity
    without
        for each batch of simulated paths the bounds from all other batches: their jackknife gives the
        standard error

    Yields
    ------
    StepColumns
        bound of a quantity at all T + 1 steps; the numbers of runs are zero
    """
    for quantity, bound in bounds.items():
        stderr = np.full_like(bound, jackknife_stderr([others[quantity] for others in without]))
        # A bound has no runs: their number is zero at every step.
        yield StepColumns(
            positions=np.arange(len(bound)),
            metrics={joined("rmse", quantity): Estimates(value=bound, stderr=stderr)},
            runs=np.zeros(len(bound), dtype=int),
        )


def _root_mean_square(x: Array) -> Array:
    return np.sqrt(average(np.square(x)))
