"""Series of errors at each step, and the metrics of each run that are computed from them.

A series is an array (T + 1, M):

``squared_<quantity>``  squared error of a quantity that the scenario names
``error_<quantity>``    signed error of a scalar quantity
``nees``                normalized error squared
``outside_region``      1 if the NEES exceeds its quantile of 1 - 1e-6 for a consistent filter, else 0
``rmsd_<quantity>``     squared distance to the reference filter's estimate
``damage_<quantity>``   length of the error less that without faults

`predictive_scores` and `consistency_and_calibration` have more series.
"""

from collections.abc import Collection, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask, any_nan
from trackbench.core.nees import by_rank
from trackbench.core.sums import WindowSums, dot, total, total_of_known
from trackbench.evaluation.innovations import innovation_metrics
from trackbench.evaluation.lost_runs import NOT_FINITE, NOT_LOST, lost_runs
from trackbench.evaluation.validate_output import checked_metrics
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import in_window, is_reserved, joined, metrics_of
from trackbench.scenarios.base import Scenario


class StepSums(NamedTuple):
    """Per step (T + 1,): sum and sum of squares over the runs that are not lost, and their number."""

    total: Array
    squares: Array
    number: Array


def series(
    scenario: Scenario,
    truth: Array,
    mean: Array,
    nees: Array,
    exact: Array | None,
    rank: Array | None = None,
    twin: Array | None = None,
) -> dict[str, Array]:
    """Return every series of errors of a block, or of some of its steps.

    Truth, mean and the reference filter's mean ``exact`` are (n_x, T + 1, M). ``nees`` and ``rank``
    (T + 1, M) are those of the covariances; ``rank`` is None if it is full everywhere. ``twin``
    (n_x, T + 1, M) is the mean of the same filter in the same runs without faults. Recorded data without
    a truth have no errors, and those of a step without a truth are NaN. The series ``rmsd`` has squares,
    like ``squared``.
    """
    rows: dict[str, Array] = {}
    if scenario.has_truth:
        rows |= _errors(scenario, mean, truth, "squared", "error")
        rows["nees"] = nees
        n = len(truth)

        def is_outside_region(squared: Array, r: int) -> Array:
            """Return 1 where a NEES of rank r exceeds its quantile of 1 - 1e-6, else 0."""
            # A NEES of rank r is stored times n / r.
            return np.asarray(squared * (r / n) > _limit_of_region(r), dtype=float)

        outside = by_rank(is_outside_region, nees, n, rank)
        rows["outside_region"] = np.where(np.isnan(nees), np.nan, outside)
    if twin is not None:
        # Damage: length of each error with faults less that without.
        for name, squared_without_faults in _errors(scenario, twin, truth, "damage").items():
            squared_with_faults = rows[name.replace("damage", "squared", 1)]
            rows[name] = np.sqrt(squared_with_faults) - np.sqrt(squared_without_faults)
    if exact is not None:
        rows |= _errors(scenario, mean, exact, "rmsd")
    return rows


def _errors(
    scenario: Scenario, mean: Array, truth: Array, squared: str, signed: str = ""
) -> dict[str, Array]:
    """Return series (T + 1, M) of the squared length of each of the scenario's error vectors.

    They are the errors of ``mean`` (n_x, T + 1, M) against ``truth``, or another mean in its place.
    ``squared`` is the first word of their names. If ``signed`` is given, scalar errors also have a
    series of signed errors, whose name begins with that word.
    """
    rows: dict[str, Array] = {}
    for quantity, vectors in scenario.errors(mean, truth).items():
        error = np.asarray(vectors, dtype=np.float64)
        rows[joined(squared, quantity)] = total(np.square(error), axis=0)
        if signed and len(error) == 1:
            rows[joined(signed, quantity)] = error[0]
    return rows


def per_run_metrics(
    scenario: Scenario,
    values: dict[str, Array],
    sums: "SeriesSums",
    finite: Mask,
    finite_truth: Mask | None = None,
    weights: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    """Return the metrics of each run (M,) over each window of steps; NaN for lost runs.

    ``values`` are the series (T + 1, M) by name, and ``sums`` their sums over the steps. ``rmse`` is
    eq. 14 of the hdepf paper. The name of a metric contains its window, as ``rmse[k<=30]``. ``finite``
    (M,) marks the runs whose estimates stayed finite. ``finite_truth`` (M,) marks those whose simulated
    truth did; it is None for recorded data. ``weights`` (T + 1, M) by name are those of the series whose
    mean over the steps is weighted. Raises ValueError if two metrics have one name.
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
        # Sums over windows of a series' "values" and of their "roots".
        self._window_sums: dict[tuple[str, str], WindowSums] = {}
        # By series: sums over the runs at each step, a piece of consecutive steps after the other.
        self._step_sums: dict[str, list[StepSums]] = {}

    @classmethod
    def from_series(
        cls, values: Mapping[str, Array], windows: Mapping[str, Mask], counts: Collection[str]
    ) -> "SeriesSums":
        """Return the sums of whole series: ``values`` are arrays (T + 1, M) by the names of the series.

        The other arguments are those of the constructor.
        """
        sums = cls(windows, counts)
        for name, rows in values.items():
            sums.add(name, rows, 0)
        return sums

    def add(self, series: str, rows: Array, first: int) -> None:
        """Add the values ``rows`` (S, M) of the steps from index ``first`` on to the named series."""
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
        """Return the sums over all runs, lost ones included, at each step; -0.0 becomes 0.0."""
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
        """Return each metric of each run (M,) over each window; ``values`` are the whole series.

        The sums over the steps have been collected by `add`.
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
    """Sum the values (T + 1, M) of a series over the runs that are not lost; NaN is left out.

    ``lost`` (M,) has a key of `LOST_BECAUSE` or `NOT_LOST` for each run. The sums are (T + 1,).
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

    ``steps`` are the sums by series, such as ``nees_position`` and ``unused_nees_position``. A block in
    which nothing is lacking has no ``unused`` series of its own, and other blocks may have one.
    """
    completed = dict(steps)
    for name, sums in steps.items():
        if name == "nis" or name.partition("_")[0] == "nees":
            zeros = np.zeros_like(sums.number)
            unused = StepSums(total=zeros, squares=zeros, number=sums.number)
            completed.setdefault(f"unused_{name}", unused)
    return completed


@cache
def _limit_of_region(n_x: int) -> float:
    """Return the value that a chi-square variable of n_x degrees exceeds with probability 1e-6."""
    from scipy.special import chdtri

    return float(chdtri(n_x, 1e-6))
