"""Metrics of each run over each window of steps: the columns of per_run.csv."""

from collections.abc import Collection, Mapping

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import total, total_of_known
from trackbench.evaluation.lost_runs import NOT_FINITE, NOT_LOST, lost_runs
from trackbench.evaluation.series_sums import SeriesSums
from trackbench.evaluation.validate_returned_arrays import checked_metrics
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import FIRST_INDEFINITE, in_window, is_reserved
from trackbench.scenarios.base import Scenario


def per_run_metrics(
    scenario: Scenario,
    values: dict[str, Array],
    sums: "SeriesSums",
    finite: Mask,
    finite_truth: Mask | None = None,
    weights: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    """Return the metrics of each run over each window of steps; NaN for lost runs.

    ``rmse`` is the root mean square error over the steps of a window. The name of a metric contains its
    window, as ``rmse[k<=30]``.

    Parameters
    ----------
    scenario
        scenario with its windows, its limit of lost runs and its own metrics
    values
        series (T + 1, M) by name
    sums
        their sums over the steps
    finite
        mask (M,) of the runs whose estimates stayed finite
    finite_truth
        mask (M,) of the runs whose simulated truth stayed finite; None for recorded data
    weights
        weights (T + 1, M) by name of the series whose mean over the steps is weighted. They are 0 where
        the series has no value (NaN). None means that no mean is weighted

    Returns
    -------
    dict
        metrics (M,) by name, among them ``lost``

    Raises
    ------
    ValueError
        if two metrics have one name, or the scenario's ``run_metrics`` returns something wrong
        (`WrongReturnError`)
    """
    # Step 1: the sums over the steps of each window.
    lost = lost_runs(scenario, values, finite, finite_truth)
    metrics = {"lost": lost}
    metrics |= sums.over_windows(values)
    for name, numbers in metrics.items():
        # Even a sum of finite squares may be infinite: the run is then lost. `lost` is the array that
        # `metrics` has, too.
        if name.startswith("rmse"):
            lost[(lost == NOT_LOST) & np.isinf(numbers)] = NOT_FINITE
    for name, weight_of_steps in (weights or {}).items():
        for window, mask in scenario.windows.items():
            weight = weight_of_steps[mask]
            with np.errstate(invalid="ignore"):  # a run may have no such measurement
                mean = total_of_known(weight * values[name][mask]) / total(weight, axis=0)
            metrics[in_window(name, window)] = mean
    # Step 2: add the scenario's own metrics. Their names must be new: neither that of a metric of the
    # errors nor that of one of the filter's diagnostics.
    for name, numbers in checked_metrics(scenario.run_metrics(values), len(lost)).items():
        if name in metrics and (name == "lost" or is_reserved(name)):
            raise WrongReturnError(
                "run_metrics", f"{name!r} is a metric of every scenario: rename it"
            )
        if name in metrics:
            raise ValueError(f"{name!r} is a metric of the scenario: rename the diagnostic")
        metrics[name] = numbers
    # Step 3: a lost run keeps the reason in `lost`; its other numbers are NaN.
    if not lost.any():
        return metrics
    without_lost_runs = {}
    for name, numbers in metrics.items():
        without_lost_runs[name] = np.where(lost == NOT_LOST, numbers, np.nan)
    return without_lost_runs | {"lost": lost}


def over_windows(
    values: Mapping[str, Array], windows: Mapping[str, Mask], counts: Collection[str]
) -> dict[str, Array]:
    """Return each metric of each run (M,) over the steps of each window, with the window in its name.

    ``values`` are the series (T + 1, M), ``windows`` the masks (T + 1,) of the steps. ``counts`` names
    the diagnostics whose metric is the sum over the steps, not the mean.
    """
    return SeriesSums.from_series(values, windows, counts).over_windows(values)


def first_indefinite_steps(scenario: Scenario, indefinite: Mask, lost: Array) -> dict[str, Array]:
    """Return the number of the first step of each run whose covariance is not positive definite.

    Parameters
    ----------
    scenario
        scenario, which has the numbers of the steps
    indefinite
        mask (T + 1, M) of these covariances
    lost
        `NOT_LOST` or the code of the reason why a run is lost, (M,)

    Returns
    -------
    dict
        metric (M,) per run by its name: NaN for a run without such a step, and for a lost run. Empty
        unless a run has such a step
    """
    marked = indefinite.any(axis=0) & (lost == NOT_LOST)
    if not marked.any():
        return {}
    first = np.asarray(scenario.steps)[indefinite.argmax(axis=0)]
    return {FIRST_INDEFINITE: np.where(marked, first, np.nan)}
