"""From estimates and truth to series per step, and from series to numbers per run.

A series is an array (T + 1, M). ``squared_<quantity>`` is the squared error of a quantity the scenario
names, ``error_<quantity>`` the signed error of a scalar one, ``nees`` the normalized error squared,
``outside_region`` whether that is more than it is once in a million times for a consistent filter,
``rmsd_<quantity>`` the squared distance to the reference filter's estimate, ``damage_<quantity>`` the
length of the error less that without faults. More: `predictive_scores`.
"""

import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask, any_nan
from trackbench.core.posterior_scores import by_rank
from trackbench.core.sums import WindowSums, dot, total
from trackbench.evaluation.validate_output import checked_metrics
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import in_window, is_reserved, joined, metrics_of
from trackbench.scenarios.base import Scenario

_OF_TRUTH = re.compile(r"squared(?!_(?:predicted|held)_)")
NOT_LOST = 0.0
NOT_FINITE = 1.0
TOO_FAR = 2.0
NO_TRUTH = 3.0
LOST_BECAUSE = {
    NOT_FINITE: "the estimate left the numbers",
    TOO_FAR: "the error passed the limit",
    NO_TRUTH: "the scenario's true state left the numbers",
}


class StepSums(NamedTuple):
    """Per step (T + 1,): sum and sum of squares over the runs that are not lost, and their number."""

    total: Array
    squares: Array
    number: Array

    def plus(self, other: "StepSums") -> "StepSums":
        """Add the sums over both sets of runs."""
        return StepSums(*(a + b for a, b in zip(self, other, strict=True)))


def series(
    scenario: Scenario,
    truth: Array,
    mean: Array,
    nees: Array,
    exact: Array | None,
    rank: Array | None = None,
    twin: Array | None = None,
) -> dict[str, Array]:
    """Return every series of a block, or of some of its steps.

    Truth, mean and the reference's mean are (n_x, T + 1, M); ``rank`` (T + 1, M) is that of the
    covariances, None if it is full everywhere; ``twin`` is the mean of the same filter without faults.
    Recorded data without a truth have no
    errors; where the truth has a gap, so have they.
    """
    out: dict[str, Array] = {}
    if scenario.has_truth:
        out |= _errors(scenario, mean, truth, "squared", "error")
        out["nees"] = nees
        n = len(truth)
        outside = by_rank(
            lambda x, r: np.asarray(x * (r / n) > _gate(r), dtype=float), nees, n, rank
        )
        out["outside_region"] = np.where(np.isnan(nees), np.nan, outside)
    if twin is not None:
        for name, squares in _errors(scenario, twin, truth, "damage").items():
            out[name] = np.sqrt(out[name.replace("damage", "squared", 1)]) - np.sqrt(squares)
    if exact is not None:
        out |= _errors(scenario, mean, exact, "rmsd")
    return out


def _errors(
    scenario: Scenario, mean: Array, other: Array, squared: str, signed: str = ""
) -> dict[str, Array]:
    """Sum the squares of each error vector; of scalar errors keep the signed value, too."""
    out: dict[str, Array] = {}
    for quantity, error in scenario.errors(mean, other).items():
        error = np.asarray(error, dtype=np.float64)
        out[joined(squared, quantity)] = total(np.square(error), axis=0)
        if signed and len(error) == 1:
            out[joined(signed, quantity)] = error[0]
    return out


def per_run_metrics(
    scenario: Scenario,
    values: dict[str, Array],
    sums: "SeriesSums",
    finite: Mask,
    finite_truth: Mask | None = None,
    weights: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    """Return numbers per run (M,) over each window, as each metric is made of its series; NaN if lost.

    ``rmse`` is eq. 14 of the hdepf paper. A name carries its window: ``rmse[k<=30]``. ``finite`` (M,)
    says whose estimates stayed within the numbers, ``finite_truth`` whose simulated truth. A series with
    ``weights`` (T + 1, M) has a weighted mean over the steps. Raises ValueError if a name would be given
    twice.
    """
    # Step 1: the sums over the steps of each window.
    lost = lost_runs(scenario, values, finite, finite_truth)
    out = {"lost": lost} | sums.over_windows(values)
    for name, numbers in out.items():
        if name.startswith("rmse"):  # the sum of finite squares may be infinite
            lost[(lost == NOT_LOST) & np.isinf(numbers)] = NOT_FINITE
    weights = weights or {}
    for name, window in product(weights, scenario.windows):
        mask = scenario.windows[window]
        weight = weights[name][mask]
        with np.errstate(invalid="ignore"):  # a run may have no such measurement
            mean = _sum(weight * values[name][mask]) / total(weight, axis=0)
        out[in_window(name, window)] = mean
    # Step 2: add the scenario's own metrics, whose names must be new.
    for name, numbers in checked_metrics(scenario.run_metrics(values), len(lost)).items():
        if name in out and (name == "lost" or is_reserved(name)):
            raise WrongReturnError(
                "run_metrics", f"{name!r} is a metric of every scenario: rename it"
            )
        if name in out:
            raise ValueError(f"{name!r} is a metric of the scenario: rename the diagnostic")
        out[name] = numbers
    # Step 3: a lost run keeps the reason; its other numbers are NaN.
    if not lost.any():
        return out
    return {n: v if n == "lost" else np.where(lost > 0, np.nan, v) for n, v in out.items()}


def rejections(z: Array, twin: Array, diagnostics: Mapping[str, Array]) -> dict[str, Array]:
    """Return which good measurements a gate rejects and which bad ones it accepts, 0 or 1 (T + 1, M).

    A measurement of z (n_z, T, M) is bad if a fault changed it from that of the ``twin`` without faults.
    It is NaN in the other series, and in both if the filter was not given it.
    """
    if not {"gated", "nis"} <= diagnostics.keys():
        return {}
    gated, nis = diagnostics["gated"], diagnostics["nis"]
    changed = (z != twin) & ~np.isnan(z)
    bad = np.insert(changed.any(axis=0), 0, False, axis=0)
    given = (gated > 0.0) | ~np.isnan(nis)
    return {
        "rejected_good": np.where(given & ~bad, gated, np.nan),
        "accepted_bad": np.where(given & bad, 1.0 - gated, np.nan),
    }


def sensor_rejections(
    z: Array, twin: Array, refused: Mask, sensors: Sequence[slice]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return `rejections` of several sensors, each with a gate: shares of each step's measurements.

    ``refused`` (n_z, T, M) are the refused components, ``sensors`` the rows of each sensor. Returned
    are also the numbers (T + 1, M) of the measurements that the shares are of.
    """
    shares = {}
    numbers = {}
    given = np.stack([~np.isnan(z[rows]).all(axis=0) for rows in sensors])
    bad = np.stack([((z != twin) & ~np.isnan(z))[rows].any(axis=0) for rows in sensors])
    rejected = np.stack([refused[rows].any(axis=0) for rows in sensors])
    for name, counted, decided in (
        ("rejected_good", given & ~bad, rejected),
        ("accepted_bad", given & bad, ~rejected),
    ):
        number = counted.sum(axis=0).astype(float)
        with np.errstate(invalid="ignore"):
            share = (counted & decided).sum(axis=0) / number
        shares[name] = np.insert(share, 0, np.nan, axis=0)
        numbers[name] = np.insert(number, 0, 0.0, axis=0)
    return shares, numbers


def over_windows(
    values: Mapping[str, Array], windows: Mapping[str, Mask], counts: Collection[str]
) -> dict[str, Array]:
    """Return each metric's numbers per run (M,) over the steps of each window, window by window."""
    return SeriesSums.of(values, windows, counts).over_windows(values)


class SeriesSums:
    """Sums of series: over the steps of each window for each run, over the runs at each step.

    A series is added in pieces of consecutive steps. ``counts`` names the diagnostics whose metric is
    the sum over the steps, not the mean.
    """

    def __init__(self, windows: Mapping[str, Mask], counts: Collection[str]) -> None:
        self._windows, self._counts = windows, counts
        self._masks = np.stack([*windows.values()])
        self._kinds: dict[str, dict[str, str]] = {}
        self._sums: dict[tuple[str, str], WindowSums] = {}
        self._of_steps = defaultdict[str, list[StepSums]](list)

    @classmethod
    def of(
        cls, values: Mapping[str, Array], windows: Mapping[str, Mask], counts: Collection[str]
    ) -> "SeriesSums":
        """Sum whole series."""
        sums = cls(windows, counts)
        for name, rows in values.items():
            sums.add(name, rows, 0)
        return sums

    def add(self, series: str, rows: Array, first: int) -> None:
        """Add the values (S, M) of the steps from ``first`` on."""
        if series not in self._kinds:
            self._kinds[series] = {
                name: m.over_steps for m, name in metrics_of(series, self._counts) if m.over_steps
            }
        kinds = self._kinds[series].values()
        columns = {"values": rows} if kinds else {}
        if "root" in kinds:
            columns["roots"] = np.sqrt(rows)  # of squares
        # Values that do not exist count as nothing; an infinite NEES of collapsed particles counts.
        for name, each in columns.items():
            if (series, name) not in self._sums:
                self._sums[series, name] = WindowSums(self._masks, rows.shape[1])
            self._sums[series, name].add(each, first)
        self._of_steps[series].append(step_sums(rows, np.full(rows.shape[1], NOT_LOST)))

    def over_runs(self) -> dict[str, StepSums]:
        """Sum over all runs at each step, lost runs too; -0.0 becomes 0.0."""
        out = {}
        for name, pieces in self._of_steps.items():
            parts = map(np.concatenate, zip(*pieces, strict=True))
            out[name] = StepSums(*(part + 0.0 for part in parts))
        return out

    @np.errstate(all="ignore")  # a run may have no value
    def over_windows(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return each metric's numbers per run (M,) by window; ``values`` are the whole series."""
        by_window: list[dict[str, Array]] = [{} for _ in self._windows]
        last = [np.flatnonzero(mask)[-1] for mask in self._masks]
        for series, wanted in self._kinds.items():
            if not wanted:
                continue
            sums = self._sums[series, "values"]
            number, mean = sums.number, sums.total / sums.number
            numbers = {"sum": sums.total, "mean": mean, "last": values[series][last]}
            if "rms" in wanted.values():
                numbers["rms"] = np.sqrt(mean)  # of squares
            if "root" in wanted.values():
                numbers["root"] = self._sums[series, "roots"].total / number
            for i, of_window in enumerate(by_window):
                of_window |= {name: numbers[how][i] for name, how in wanted.items()}
        out: dict[str, Array] = {}
        for window, of_window, mask in zip(self._windows, by_window, self._masks, strict=True):
            of_window |= _of_innovations(values, mask)
            out |= {in_window(name, window): rows for name, rows in of_window.items()}
        return out


def _of_innovations(values: Mapping[str, Array], mask: Mask) -> Iterator[tuple[str, Array]]:
    """Yield sums over steps and components, over their number and over those of lag 0."""
    if "innovations" not in values:
        return
    # ANIS = sum of NIS over the number of measured components.
    nis = _sum((values["anis"] * values["innovations"])[mask])
    yield "anis", nis / _sum(values["innovations"][mask])
    # Autocorrelation = sum of lagged products over sum of squares (lag 0).
    for name, rows in values.items():
        if name.startswith("autocovariance_"):
            paired = ~np.isnan(rows[mask]).all(axis=0)
            correlation = np.where(paired, _sum(rows[mask]) / nis, np.nan)
            yield name.replace("covariance", "correlation"), correlation


def lost_runs(
    scenario: Scenario,
    values: dict[str, Array],
    finite: Mask,
    finite_truth: Mask | None = None,
) -> Array:
    """Return why each run (M,) is lost.

    It is 0 not lost, 1 an estimate or an error that is not finite, 2 an error beyond ``lost_beyond``,
    3 a simulated truth that is not finite.
    """
    errors = [rows for name, rows in values.items() if _OF_TRUTH.match(name)]
    # Without a truth only estimates that are not finite count as lost.
    if not errors:
        return np.where(finite, NOT_LOST, NOT_FINITE)
    infinite = np.logical_or.reduce([np.isinf(rows).any(axis=0) for rows in errors])
    lost = np.where(finite & ~infinite, NOT_LOST, NOT_FINITE)
    # The first error of the scenario is limited.
    first = errors[0]
    limit = scenario.lost_beyond
    if limit is not None:
        lost = np.where((lost == NOT_LOST) & (first > limit * limit).any(axis=0), TOO_FAR, lost)
    return lost if finite_truth is None else np.where(finite_truth, lost, NO_TRUTH)


def step_sums(rows: Array, lost: Array) -> StepSums:
    """Sum over the runs that are not lost and whose value exists."""
    not_lost = lost == NOT_LOST
    if not_lost.all() and not any_nan(rows):
        return StepSums(total(rows), dot(rows, rows), np.full(len(rows), float(rows.shape[1])))
    counted: Mask = not_lost & ~np.isnan(rows)
    counted_rows = np.where(counted, rows, 0.0)
    return StepSums(
        total(counted_rows), dot(counted_rows, counted_rows), counted.sum(axis=1).astype(float)
    )


def with_unused(steps: dict[str, StepSums]) -> dict[str, StepSums]:
    """Add the sums of the components that each NEES and NIS lacks, of none as zeros."""
    out = dict(steps)
    for name, sums in steps.items():
        if name == "nis" or name.partition("_")[0] == "nees":
            none = np.zeros_like(sums.number)
            out.setdefault(f"unused_{name}", StepSums(none, none, sums.number))
    return out


@cache
def _gate(n_x: int) -> float:
    """Return the chi-square value that is exceeded with probability 1e-6."""
    from scipy.special import chdtri

    return float(chdtri(n_x, 1e-6))


def _sum(rows: Array) -> Array:
    return total(np.where(np.isnan(rows), 0.0, rows), axis=0)
