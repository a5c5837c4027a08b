"""Check that covariances are symmetric and positive definite, also over a config's whole experiment."""

import numpy as np

from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import ContractError
from trackbench.contract.problems import ModelDraws, WholeExperiment
from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, Mask
from trackbench.errors import counted
from trackbench.filters.base import AnyFilter
from trackbench.filters.float32_digits import float32_advice
from trackbench.scenarios.base import Scenario

_TOLERANCE = 1e-7  # of correlations, in float64
_FLOAT32_TOLERANCE = 1e-6  # of correlations, in float32
_FLOAT32_COVARIANCE = (
    "the filter computes in float32: make P symmetric after each step, and take the Joseph form or a "
    "square root of P, or compute in double"
)


def check_covariance(tracker: AnyFilter, scenario: Scenario) -> str:
    """Check that covariances are symmetric and positive definite; return what was tried.

    Of a config's problem the runs of the experiment itself are tried, too, over its whole length: a
    covariance may become indefinite late, and off the model.
    """
    tried = _try_covariances(tracker, scenario, runs=20)
    if isinstance(scenario, ModelDraws):
        whole = WholeExperiment(base=scenario.base)
        tried += f" and {_try_covariances(tracker, whole, whole.runs, ' of the experiment')}"
    return tried


def _try_covariances(tracker: AnyFilter, problem: Scenario, runs: int, source: str = "") -> str:
    """Check the covariances of some runs of a problem; return a text with the number of runs and steps.

    ``source`` is a text that is put after it, such as " of the experiment".
    """
    estimates = run_filter(tracker, problem, simulate(problem, runs))
    # A recording may have fewer runs.
    runs = min(runs, problem.recorded_runs or runs)
    tried = f"{counted(runs, 'run')} of {counted(len(problem.steps) - 1, 'step')}{source}"
    try:
        _require_covariances(estimates.cov, problem.steps, tried)
    except ContractError as error:
        if not _is_float32(estimates.cov[:, :, 1:]):
            raise
        # The rounding of float32 is the likely cause: add how to compute in double.
        components = problem.model.motion.components
        advice = float32_advice(estimates.mean[:, 1:], estimates.cov[:, :, 1:], components)
        raise ContractError(f"{error}; {advice or _FLOAT32_COVARIANCE}") from None
    return tried


def _require_covariances(P: Array, steps: Index, tried: str) -> None:
    """Raise ContractError unless P (n, n, T + 1, M) are symmetric and positive definite up to rounding.

    A zero eigenvalue is accepted, and one so little below zero that rounding explains it. ``steps``
    (T + 1,) are the numbers of the steps, ``tried`` names the runs.
    """
    known = np.isfinite(P)
    if (known != np.swapaxes(known, 0, 1)).any():
        raise ContractError(
            "not symmetric: an entry is NaN or infinite, and its mirror image is not"
        )
    # Compare correlations, so that units do not matter. The least sigma keeps those of a component that
    # is known exactly or has collapsed from being rounding errors.
    sigma = np.sqrt(np.abs(linalg.diagonal(P)))
    least_sigma = 1e-6 * np.nanmax(sigma, axis=(1, 2), keepdims=True)
    limited_sigma = np.maximum(sigma, least_sigma)
    scale = np.where(limited_sigma > 0.0, limited_sigma, 1.0)
    all_correlations = np.moveaxis(P / (scale[:, None] * scale), (0, 1), (-2, -1))
    # Entries that are not finite count as zero: they are reported by other checks.
    is_finite = np.isfinite(all_correlations).all(axis=(-2, -1))
    correlations = np.where(is_finite[..., None, None], all_correlations, 0.0)
    difference = np.abs(correlations - np.swapaxes(correlations, -2, -1)).max(axis=(-2, -1))
    # The tolerance is that of rounding. The entries are stored in float64, but a filter may compute them
    # in float32: they are then equal to their float32 values.
    tolerance = _FLOAT32_TOLERANCE if _is_float32(P) else _TOLERANCE
    if difference.max() > tolerance:
        where = _name_places(difference > tolerance, steps, tried)
        message = f"not symmetric: correlations differ by {difference.max():.2g}, {where}"
        raise ContractError(f"{message}; keep (P + P') / 2 after each update")
    least_eigenvalue = np.linalg.eigvalsh(correlations).min(axis=-1)
    if least_eigenvalue.min() < -tolerance:
        where = _name_places(least_eigenvalue < -tolerance, steps, tried)
        message = f"the correlations have an eigenvalue {least_eigenvalue.min():.2g}, {where}"
        raise ContractError(f"not positive definite: {message}")


def _is_float32(values: Array) -> bool:
    """Test whether the variances of covariances (n, n, ...) are numbers of float32.

    Covariances of a program may be made symmetric: such an entry is the mean of two float32 numbers, and
    no such number itself.
    """
    variances = np.einsum("ii...->i...", values)
    with np.errstate(over="ignore", under="ignore"):
        return np.array_equal(variances, np.float32(variances), equal_nan=True)


def _name_places(is_wrong: Mask, steps: Index, tried: str) -> str:
    """Name the first step with a mistake, and the number of runs that have one.

    ``is_wrong`` (T + 1, M) marks the mistakes, and ``steps`` (T + 1,) are the numbers of the steps.
    ``tried`` is the text on how many runs and steps were tried.
    """
    first = int(steps[np.flatnonzero(is_wrong.any(axis=1))[0]])
    return f"first at step {first}, in {is_wrong.any(axis=0).sum()} of {tried}"
