"""Check that estimates on a linear model equal those of the Kalman filter."""

import numpy as np

from trackbench.contract.compare_with_references import runs_for
from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import ContractError
from trackbench.contract.missing_measurements_check import with_gaps
from trackbench.contract.problems import PLANAR, UNEQUAL
from trackbench.contract.why_not_running import runs_on, why_not
from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.scenarios.base import Scenario

_MAX_DEVIATION = 4.5  # standard errors; none of a few dozen comparisons should exceed it
_MOST_PARTICLE_BIAS = 3.0  # largest accepted bias of N particles, in units of sigma / N


def check_against_kalman(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that estimates on a linear model equal those of the Kalman filter.

    UNEQUAL is the contract's linear problem whose steps have unequal intervals. A filter that does not
    run on it is checked on PLANAR, with equal intervals.
    """
    problem = UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR
    # On a linear model the EKF is the Kalman filter.
    message = difference_from_ekf(tracker, problem, runs_for(tracker))
    if message:
        raise ContractError(message)


def difference_from_ekf(tracker: AnyFilter, scenario: Scenario, runs: int) -> str:
    """Describe how estimates differ from the EKF's; empty if rounding or chance explain it.

    The scenario may be linear, where the EKF is the Kalman filter, or not. If the EKF does not run on
    it, the text says so. For a filter that draws random numbers only a bias of its means counts.
    """
    if why_not(EKF(), scenario):
        return "the EKF does not run there"
    data = with_gaps(simulate(scenario, runs))
    tested = run_filter(tracker, scenario, data)
    ekf = run_filter(EKF(), scenario, data)
    sigma = np.sqrt(linalg.diagonal(ekf.cov))
    error = near(tested.mean, ekf.mean, scenario.angle_rows) - ekf.mean
    if tested.random:
        # A filter that draws random numbers, but has no particles, may have the bias of 100 particles.
        N = tracker.particle_count if tracker.particle_count > 1 else 100
        return _describe_bias(error, sigma, N)
    deviation = float((np.abs(error) / np.maximum(sigma, np.finfo(float).tiny)).max())
    # What rounding leaves is far below 1e-6.
    if deviation > 1e-6:
        return f"the mean is off by up to {deviation:.2g} standard deviations"
    relative_difference = np.abs(tested.cov / ekf.cov - 1.0)
    largest = float(relative_difference[ekf.cov != 0.0].max())
    if largest > 1e-6:
        return f"the covariance is off by up to {100 * largest:.2g} %"
    return ""


def _describe_bias(error: Array, sigma: Array, N: int) -> str:
    """Describe a bias of a filter with N particles; empty if chance and N explain it.

    ``error`` (n, T + 1, M) is the difference of the filter's means from the EKF's, ``sigma``
    (n, T + 1, M) the EKF's standard deviation. The bias is the mean error over the M runs.
    """
    stderr = error.std(axis=-1, ddof=1) / np.sqrt(error.shape[-1])
    # N particles have a bias of the order of sigma / N. The factor leaves room above that.
    allowed_bias = _MAX_DEVIATION * stderr + _MOST_PARTICLE_BIAS * sigma.mean(axis=-1) / N
    bias = np.abs(error.mean(axis=-1))
    if not (bias > allowed_bias).any():
        return ""
    largest_ratio = float((bias / allowed_bias).max())
    return f"the mean is biased, by {largest_ratio:.1f} times what chance and N allow"
