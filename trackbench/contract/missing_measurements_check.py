"""Check of a filter with missing measurements: it predicts there, and does not take them as numbers."""

import numpy as np

from trackbench.contract.estimates import Estimates, has_constant_covariance, run_filter, simulate
from trackbench.contract.findings import ContractError
from trackbench.core.arrays import Array
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario, Simulation


def with_gaps(data: Simulation) -> Simulation:
    """Return the data with some measurements missing (NaN), in two of three runs."""
    # Every fourth step of the runs 0, 3, 6, ..., and every fifth step of the runs 1, 4, 7, ...
    z = data.measurements.copy()
    z[:, 2::4, ::3] = np.nan
    z[:, 3::5, 1::3] = np.nan
    return data._replace(measurements=z)


def check_gaps(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter predicts where a measurement is missing, and does not take it as a number."""
    data = simulate(scenario, runs=6)
    z = data.measurements
    # The second measurement of every other run is missing: the third estimate, since the first one is
    # that of the prior.
    is_gap = np.zeros(z.shape, dtype=bool)
    is_gap[:, 1, ::2] = True

    def estimate_at_gaps(fill: Array | float) -> Estimates:
        """Estimate the states at the gaps, whose measurements are replaced by ``fill``."""
        filled = data._replace(measurements=np.where(is_gap, fill, z))
        estimates = run_filter(tracker, scenario, filled)
        return estimates._replace(mean=estimates.mean[:, 2, ::2], cov=estimates.cov[:, :, 2, ::2])

    missing = estimate_at_gaps(np.nan)
    measured = estimate_at_gaps(z)
    if not np.isfinite(missing.mean).all():
        raise ContractError("the estimate is not finite where a measurement is missing (NaN)")
    if np.array_equal(missing.mean, measured.mean):
        return  # the filter uses no measurement
    # A filter with a gate ignores measurements that are far away, and perhaps zero. Its estimates then
    # equal those at a gap, which is no mistake.
    far_away = estimate_at_gaps(1e3 * (1.0 + float(np.nanmax(np.abs(z)))))
    has_gate = np.array_equal(missing.mean, far_away.mean)
    replacements: dict[str, Array | float] = {
        "zero": 0.0,
        "the one before": np.roll(z, 1, axis=1),
    }
    for name, replacement in replacements.items():
        replaced = estimate_at_gaps(replacement)
        if np.array_equal(missing.mean, replaced.mean) and not has_gate:
            symbol = "NaN" if tracker.runs_program else "NaN, or None per run"
            raise ContractError(f"a missing measurement ({symbol}) is taken as {name}")
    if not np.allclose(missing.cov, measured.cov, rtol=1e-9, atol=0.0):
        return
    # A measurement must change the covariance, unless the filter has a constant one.
    if not has_constant_covariance(run_filter(tracker, scenario, data)):
        message = "the covariance is the same with and without a measurement"
        message += ": does the update reduce it?"
        if tracker.runs_program:
            message += (
                " A program of constant gain answers one covariance to all lines, or the mean alone"
            )
        raise ContractError(message)
