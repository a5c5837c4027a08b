"""Exact mean square errors of linear filters, computed without Monte Carlo runs.

If estimates are affine in the normal variates w of a run, every squared error q(w) is quadratic, and its
mean follows from the values at the unit vectors u_j::

    E q(w) = q(0) + sum_j [ (q(u_j) + q(-u_j)) / 2 - q(0) ]

q(0) is the squared bias, and the sum is the trace of the errors' covariance (Kurt & Orguner 2025, arXiv
2511.22034). Scenario and filter are run as they are, on streams that return these vectors.
"""

import re
from collections.abc import Callable
from functools import lru_cache
from math import prod
from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Index, freeze
from trackbench.core.random_streams import RunStreams
from trackbench.core.sums import total
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.error_series import series
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.base import AnyFilter
from trackbench.models.assumed_sensor import Assume
from trackbench.scenarios.base import Scenario, Simulation

_QUADRATIC = re.compile(r"(squared|error|nees)(_.+)?|nis")
"""Series that are polynomials of degree two at most in the errors; P and S depend on no measurement."""
_VARIATES = 256  # unit vectors computed together
_TOLERANCE = 1e-9  # of rounding, as a share of the largest number


def exact_label(label: str) -> str:
    """Return the label under which the exact errors of a filter stand in tables and figures."""
    return f"{label}, exact"


class _NotNormalError(ValueError):
    """A scenario draws variates that are not normal."""


class _FixedNormals:
    """Streams whose normal variates are given: ``variates`` returns rows j (J, M) of all runs."""

    def __init__(self, variates: Callable[[Index], Array]) -> None:
        self._variates, self.drawn = variates, 0

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return the next of the given variates."""
        rows = np.arange(self.drawn, self.drawn + prod(size[:-1]))
        self.drawn += len(rows)
        return self._variates(rows).reshape(size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Reject uniform variates."""
        raise _NotNormalError

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Reject gamma variates."""
        raise _NotNormalError


def _simulate(
    scenario: Scenario, variates: Callable[[Index], Array], runs: int
) -> tuple[Simulation, int]:
    """Return the data of these normal variates, and the number of variates per run."""
    streams = _FixedNormals(variates)
    data = freeze(scenario.simulate(cast(RunStreams, streams), runs))
    return data, streams.drawn


def _task(scenario: Scenario, tracker: AnyFilter, assume: Assume | None, runs: int) -> BlockTask:
    return BlockTask(scenario, tracker, 0, index=0, width=runs, runs_used=runs, assume=assume)


@lru_cache(maxsize=64)
@np.errstate(all="ignore")
def why_not_exact(scenario: Scenario, tracker: AnyFilter, assume: Assume | None) -> str | None:
    """Return the reason why a filter has no exact errors; None if it has."""
    if not tracker.is_linear:
        what = f"the gain of `{tracker.kind}` depends on the measurements, or may do so"
        return f"{what}; take a `kf` without `gate`, or an `alpha-beta`"
    if scenario.recorded_runs is not None or not scenario.has_truth:
        return "the measurements are recorded: nothing of them is random"
    try:
        data, _ = _simulate(scenario, _dense_variates, 4)
    except _NotNormalError:
        what = "the scenario draws more than normal noise: a random path, `detection` below 1"
        return f"{what}, `outliers`, noise or a first state of another law"
    if not (_is_affine(data.truth) and _is_affine(data.measurements)):
        return "path or measurements are not linear in the noise; take a linear sensor and motion"
    if not _is_affine(run_filter(_task(scenario, tracker, assume, 4), data).mean):
        return f"the estimates of `{tracker.kind}` are not linear in the measurements"
    return None


def _dense_variates(rows: Index) -> Array:
    """Return variates (J, 4): zeros, two vectors a and b, and a + b."""
    a, b = (37 * rows % 11 - 5) / 3.0, (23 * rows % 7 - 3) / 2.0
    return np.stack([np.zeros(len(rows)), a, b, a + b], axis=1)


def _is_affine(x: Array) -> bool:
    """Return whether f(a + b) + f(0) = f(a) + f(b), of values (..., 4) at 0, a, b and a + b."""
    known = x[~np.isnan(x).all(axis=-1)]
    difference = known[..., 3] + known[..., 0] - known[..., 1] - known[..., 2]
    return bool(np.all(np.abs(difference) <= _TOLERANCE * np.abs(known).max(initial=0.0)))


@np.errstate(all="ignore")
def exact_series(scenario: Scenario, tracker: AnyFilter, assume: Assume | None) -> dict[str, Array]:
    """Return the means (T + 1,) over all runs of squared errors, signed errors, NEES and NIS.

    Parameters
    ----------
    scenario : Scenario
        Linear in normal noise, as `why_not_exact` checks.
    tracker : Filter
        A filter whose estimates are linear in the measurements.
    assume : Assume, optional
        What the filter assumes that is not the scenario's.

    References
    ----------
    Kurt & Orguner 2025, arXiv 2511.22034.
    """
    _, number = _simulate(scenario, lambda rows: np.zeros((len(rows), 1)), 1)
    means: dict[str, Array] = {}
    for first in range(0, max(number, 1), _VARIATES):
        # Step 1: run the filter on no noise, and on each unit vector u_j and its negative.
        places = np.arange(first, min(first + _VARIATES, number)).repeat(2)
        signs = np.where(np.arange(len(places)) % 2, -1.0, 1.0)
        q = _quadratics(scenario, tracker, assume, places, signs)
        # Step 2: E q = q(0) + sum_j [ (q(u_j) + q(-u_j)) / 2 - q(0) ]
        for name, rows in q.items():
            at_zero, up, down = rows[:, :1], rows[:, 1::2], rows[:, 2::2]
            variance = total(0.5 * (up + down) - at_zero)
            means[name] = means.get(name, at_zero[:, 0]) + variance
    return means


def _quadratics(
    scenario: Scenario, tracker: AnyFilter, assume: Assume | None, places: Index, signs: Array
) -> dict[str, Array]:
    """Return series (T + 1, 1 + J): without noise, and with one variate ``places`` of size ``signs``."""

    def unit_vectors(rows: Index) -> Array:
        of_units = np.where(rows[:, None] == places, signs, 0.0)
        return np.concatenate([np.zeros((len(rows), 1)), of_units], axis=1)

    data, _ = _simulate(scenario, unit_vectors, 1 + len(places))
    output = run_filter(_task(scenario, tracker, assume, 1 + len(places)), data)
    values = series(scenario, data.truth, output.mean, output.nees, None) | output.diagnostics
    return {name: rows for name, rows in values.items() if _QUADRATIC.fullmatch(name)}
