"""From estimates and truth to series per step, and from series to numbers per run.

A series is an array (T + 1, M). ``squared_<quantity>`` is the squared error of a quantity the scenario
names, ``error_<quantity>`` the signed error of a scalar one, ``nees`` the normalized error squared,
``outside_region`` whether that is more than it is once in a million times for a consistent filter,
``rmsd_<quantity>`` the squared distance to the reference filter's estimate. `foretelling` has more.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import dot, total
from trackbench.evaluation.validate_output import checked_metrics
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import in_window, is_reserved, joined, metrics_of
from trackbench.scenarios.base import Scenario

_OF_TRUTH = re.compile(r"squared(?!_(?:predicted|held)_)")
FOUND, NOT_FINITE, TOO_FAR = 0.0, 1.0, 2.0
_COLUMNS = 8192  # runs times steps whose errors are computed at a time
LOST_BECAUSE = {NOT_FINITE: "the estimate left the numbers", TOO_FAR: "the error passed the limit"}


class StepSums(NamedTuple):
    """Per step (T + 1,): sum and sum of squares over the runs that are not lost, and their number."""

    total: Array
    squares: Array
    number: Array

    def plus(self, other: "StepSums") -> "StepSums":
        """Return the sums over both sets of runs."""
        return StepSums(*(a + b for a, b in zip(self, other, strict=True)))


def series(
    scenario: Scenario, truth: Array, mean: Array, nees: Array, exact: Array | None
) -> dict[str, Array]:
    """Return every series of a block; truth, mean and the reference's mean are (n_x, T + 1, M).

    Recorded data without a truth have no errors; where the truth has a gap, so have they.
    """
    out: dict[str, Array] = {}
    if scenario.has_truth:
        out |= _errors(scenario, mean, truth, "squared", "error")
        out["nees"] = nees
        out["outside_region"] = np.where(np.isnan(nees), np.nan, nees > _gate(len(truth)))
    if exact is not None:
        out |= _errors(scenario, mean, exact, "rmsd")
    return out


def _errors(
    scenario: Scenario, mean: Array, other: Array, squared: str, signed: str = ""
) -> dict[str, Array]:
    """Return the squared norm of each error vector; of scalar errors the signed value, too."""
    out: dict[str, Array] = {}
    steps, runs = mean.shape[1:]
    # The steps are taken in pieces that stay in the cache.
    at_a_time = max(1, _COLUMNS // runs)
    for first in range(0, steps, at_a_time):
        part = slice(first, first + at_a_time)
        for quantity, error in scenario.errors(mean[:, part], other[:, part]).items():
            rows = {joined(squared, quantity): total(np.square(error), axis=0)}
            if signed and len(error) == 1:
                rows[joined(signed, quantity)] = error[0]
            for name, values in rows.items():
                if name not in out:
                    out[name] = np.empty((steps, runs))
                out[name][part] = values
    return out


def per_run_metrics(
    scenario: Scenario, values: dict[str, Array], counts: Collection[str], finite: Mask
) -> dict[str, Array]:
    """Return numbers per run (M,) over each window, as each metric is made of its series; NaN if lost.

    ``rmse`` is eq. 14 of the hdepf paper. A name carries its window: ``rmse[k<=30]``. ``finite`` (M,)
    says whose estimates stayed within the numbers. Raises ValueError if a name would be given twice.
    """
    # Step 1: reduce every series over the steps of each window.
    lost = lost_runs(scenario, values, finite)
    out = {"lost": lost} | over_windows(values, scenario.windows, counts)
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
    return {n: v if n == "lost" else np.where(lost > 0, np.nan, v) for n, v in out.items()}


def over_windows(
    values: Mapping[str, Array], windows: Mapping[str, Mask], counts: Collection[str]
) -> dict[str, Array]:
    """Return each metric's numbers per run (M,) over the steps of each window, window by window."""
    found: dict[str, dict[str, Array]] = {window: {} for window in windows}
    steps = {window: _as_slice(mask) for window, mask in windows.items()}
    for series, rows in values.items():
        wanted = {name: m.over_steps for m, name in metrics_of(series, counts) if m.over_steps}
        if not wanted:
            continue
        kinds = set(wanted.values())
        # Step 1: values that do not exist add zero; an infinite NEES of collapsed particles counts.
        missing = np.isnan(rows)
        complete = not missing.any()
        known = rows if complete else np.where(missing, 0.0, rows)
        roots = np.sqrt(known) if "root" in kinds else known  # of squares
        # Step 2: sums over the steps of each window, and over the number of existing values.
        for window, mask in windows.items():
            part = steps[window]
            number = mask.sum() if complete else mask.sum() - missing[part].sum(axis=0)
            added = total(known[part], axis=0)
            mean = np.asarray(added / number)
            of_window = {"sum": added, "mean": mean, "last": rows[part][-1]}
            if "rms" in kinds:
                of_window["rms"] = np.sqrt(mean)  # of squares
            if "root" in kinds:
                of_window["root"] = np.asarray(total(roots[part], axis=0) / number)
            found[window] |= {name: of_window[how] for name, how in wanted.items()}
    for window, mask in windows.items():
        found[window] |= _of_innovations(values, mask)
    return {in_window(n, w): numbers for w, of_w in found.items() for n, numbers in of_w.items()}


def _as_slice(mask: Mask) -> slice | Mask:
    """Return consecutive steps as a slice, whose rows need no copy."""
    part = slice(mask.argmax(), len(mask) - mask[::-1].argmax())
    return part if mask[part].all() else mask


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
            found = np.where(paired, _sum(rows[mask]) / nis, np.nan)
            yield name.replace("covariance", "correlation"), found


def lost_runs(scenario: Scenario, values: dict[str, Array], finite: Mask) -> Array:
    """Return why each run (M,) is lost: 0 not lost, 1 not finite, 2 error beyond ``lost_beyond``."""
    errors = [rows for name, rows in values.items() if _OF_TRUTH.match(name)]
    # Without a truth only estimates that are not finite count as lost.
    if not errors:
        return np.where(finite, FOUND, NOT_FINITE)
    # The first error of the scenario decides.
    first = errors[0]
    lost = np.where(finite & ~np.isinf(first).any(axis=0), FOUND, NOT_FINITE)
    limit = scenario.lost_beyond
    if limit is not None:
        lost = np.where((lost == FOUND) & (first > limit * limit).any(axis=0), TOO_FAR, lost)
    return lost


def step_sums(rows: Array, lost: Array) -> StepSums:
    """Return sums over the runs that are not lost and whose value exists."""
    counted: Mask = (lost == FOUND) & ~np.isnan(rows)
    kept = rows if counted.all() else np.where(counted, rows, 0.0)
    return StepSums(total(kept), dot(kept, kept), counted.sum(axis=1).astype(float))


@cache
def _gate(n_x: int) -> float:
    """Return the chi-square value that is exceeded with probability 1e-6."""
    from scipy.special import chdtri

    return float(chdtri(n_x, 1e-6))


def _sum(rows: Array) -> Array:
    return total(np.where(np.isnan(rows), 0.0, rows), axis=0)
