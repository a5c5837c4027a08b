"""The checks of the contract: each raises ContractError with what it found."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import fields, is_dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.contract.fixtures import filtered, kalman_filtered, noise, simulated
from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.evaluation.validate_output import check_estimate, check_names, checked_numbers
from trackbench.filters.base import declares_diagnostics, has_likelihood


class Finding(NamedTuple):
    """One check of the contract: what was looked at, how it went, and why."""

    check: str
    verdict: Literal["good", "bad", "left out"]
    why: str = ""

    def __str__(self) -> str:
        return f"{self.verdict:>8}  {self.check}" + (f": {self.why}" if self.why else "")


class ContractError(Exception):
    """The filter does not do what it promised."""


_RUNS = 200


_OUTLIER = 4.5  # standard errors; of a few dozen comparisons none should be beyond


def _shapes(tracker: Any, scenario: Any) -> None:
    runs, rng = 5, noise()
    data = simulated(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    for i, k in enumerate(scenario.steps):
        if i:
            state = tracker.step(scenario.model, state, data.measurements[:, i - 1], int(k), rng)
        found = tracker.estimate(state)
        check_estimate(found, (n, n), runs)
        _check_array(f"mean at step {k}", found.mean)
        _check_array(f"cov at step {k}", found.cov)
        noted = checked_numbers("diagnostic", tracker.diagnostics(state), runs)
        check_names(noted)
        if (
            i
            and declares_diagnostics(type(tracker))
            and set(noted) != set(tracker.diagnostic_names)
        ):
            raise ContractError(
                f"diagnostic_names is {sorted(tracker.diagnostic_names)}, diagnostics {sorted(noted)}"
            )
        if i and has_likelihood(tracker):
            checked_numbers("series", {"log_likelihood": tracker.log_likelihood(state)}, runs)


def _check_array(name: str, array: Any) -> None:
    if np.asarray(array).dtype != np.float64:
        raise ContractError(f"{name} is of {np.asarray(array).dtype}")
    if not np.isfinite(array).all():
        raise ContractError(f"{name} is not finite")


def _purity(tracker: Any, scenario: Any) -> None:
    data = simulated(scenario, 5)
    prior = deepcopy(data.prior)
    state = tracker.init(scenario.model, data.prior, noise())
    if not _same(prior, data.prior):
        raise ContractError("the prior is written to; make a new array")
    z, k = data.measurements[:, 0], int(scenario.steps[1])
    kept = deepcopy((state, z))
    first = tracker.estimate(tracker.step(scenario.model, state, z, k, noise()))
    if not _same(kept, (state, z)):
        raise ContractError("the state or the measurement is written to; make a new array")
    again = tracker.estimate(tracker.step(scenario.model, state, z, k, noise()))
    if not np.array_equal(first.mean, again.mean, equal_nan=True):
        raise ContractError("the same step with the same noise gives another estimate")


def _repeats(tracker: Any, scenario: Any) -> None:
    data = simulated(scenario, 3)
    first, again = (filtered(tracker, scenario, data) for _ in range(2))
    if not np.array_equal(first.mean, again.mean, equal_nan=True):
        raise ContractError(
            "the estimates are others the second time: noise comes from `rng` alone"
        )


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, tuple | list):
        return all(_same(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return True


def _independence(tracker: Any, scenario: Any) -> None:
    runs = 6
    data = simulated(scenario, runs)
    whole = filtered(tracker, scenario, data)
    for run, others in ((0, slice(1, None)), (-1, slice(None, -1))):
        other = data.measurements.copy()
        other[..., run] += 1.0
        moved = filtered(tracker, scenario, data._replace(measurements=other))
        if not np.array_equal(whole.mean[..., others], moved.mean[..., others], equal_nan=True):
            raise ContractError(
                "another measurement in one run changes the estimates of the others"
            )
    if not whole.random:
        turned = filtered(tracker, scenario, simulated(scenario, runs, step=-1)).mean[..., ::-1]
        if not np.allclose(turned, whole.mean, rtol=1e-10, atol=1e-10, equal_nan=True):
            raise ContractError("the runs come out differently in another order")
        alone = filtered(tracker, scenario, simulated(scenario, 1))
        if not np.allclose(alone.mean, whole.mean[..., :1], rtol=1e-10, atol=1e-10, equal_nan=True):
            raise ContractError("the first run comes out differently without the others")


def _gaps(tracker: Any, scenario: Any) -> None:
    data = simulated(scenario, 5)
    seen = data.measurements.copy()
    seen[:, 1, ::2] = np.nan
    if not np.isfinite(filtered(tracker, scenario, data._replace(measurements=seen)).mean).all():
        raise ContractError("the estimate is not finite where a measurement is missing (NaN)")


def _equals_kalman(tracker: Any, scenario: Any) -> None:
    data = simulated(scenario, _RUNS)
    mine, exact = filtered(tracker, scenario, data), kalman_filtered(scenario, data)
    error, sigma = mine.mean - exact.mean, np.sqrt(linalg.diagonal(exact.cov))
    if mine.random:
        _check_unbiased(error, sigma, tracker.particle_count if tracker.particle_count > 1 else 100)
        return
    off = float(np.abs(error / sigma).max())
    if off > 1e-6:
        raise ContractError(f"the mean is off by up to {off:.2g} standard deviations")
    ratio = float(np.abs(mine.cov / exact.cov - 1.0)[exact.cov != 0.0].max())
    if ratio > 1e-6:
        raise ContractError(f"the covariance is off by up to {100 * ratio:.2g} %")


def _check_unbiased(error: Array, sigma: Array, N: int) -> None:
    stderr = error.std(axis=-1, ddof=1) / np.sqrt(_RUNS)
    # A cloud of N points has a bias of the order of sigma / N.
    allowed = _OUTLIER * stderr + 3.0 * sigma.mean(axis=-1) / N
    bias = np.abs(error.mean(axis=-1))
    if (bias > allowed).any():
        worst = float((bias / allowed).max())
        raise ContractError(f"the mean is biased, by {worst:.1f} times what chance and N allow")


CHECKS: dict[str, tuple[str, Callable[[Any, Any], None]]] = {
    "shapes": ("shapes", _shapes),
    "purity": ("step changes nothing it is given", _purity),
    "repeats": ("the same runs give the same again", _repeats),
    "independence": ("a run does not see the others", _independence),
    "gaps": ("a missing measurement is predicted over", _gaps),
    "kalman": ("equals the Kalman filter on a linear model", _equals_kalman),
}
"""By the name that excuses a filter from it: what it is called, and the check."""
