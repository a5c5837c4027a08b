"""Check that the estimates follow a fast target in the plane."""

from typing import cast

import numpy as np

from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.likely_cause import FIRST_FITTED, guess_cause_of_errors
from trackbench.contract.problems import PLANAR, PRECISE
from trackbench.contract.why_not_running import runs_on
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.models.base import LocatingSensor
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.tracking import Tracking


def mistaken_track(tracker: AnyFilter, problem: Tracking) -> str:
    """Describe how estimates miss the path of a fast target; empty if they follow it.

    The estimates are compared with the truth alone, so that the filter may have any model.
    """
    data = simulate(problem, runs=40)
    estimates = run_filter(tracker, problem, data)
    # Step 1: estimates from another prior, here with 100 (m, m/s) added to its mean, must differ.
    moved_prior = Gaussian(data.prior.mean + 100.0, data.prior.cov)
    moved_estimates = run_filter(tracker, problem, data._replace(prior=moved_prior))
    if np.array_equal(estimates.mean[:, 1], moved_estimates.mean[:, 1]):
        return "the estimates do not depend on the mean of the prior: is it ignored?"

    # Step 2: positions (2, T + 1, M) of the filter, of a prediction alone, and measured. They are the
    # rows 0 and 2 of a state.
    z = data.measurements
    position = estimates.mean[:4:2]
    without_measurements = data._replace(measurements=np.full_like(z, np.nan))
    predicted = run_filter(EKF(), problem, without_measurements).mean[::2]
    sensor = cast(LocatingSensor, problem.model.sensor)
    true_position = data.truth[::2]
    located = [sensor.located(z[:, i], i + 1).mean for i in range(z.shape[1])]
    # The step of the prior has no measurement: the true position stands for it.
    measured = np.stack([true_position[:, 0], *located], axis=1)

    def rms_error(position: Array, true_position: Array = true_position) -> float:
        """Return the error, m, after the first steps, which depend on the prior."""
        # The median over the runs: a lost run does not count.
        squared = np.square(position - true_position)[:, FIRST_FITTED:]
        return float(np.sqrt(np.median(squared.mean(axis=(0, 1)))))

    # Step 3: the error of a correct filter is at most about that of the predictions from the prior, or
    # that of the measured positions.
    error = rms_error(position)
    error_from_earlier = rms_error(position, np.roll(true_position, 1, axis=1))
    # A late estimate is far nearer to the true position of the step before.
    is_late = error_from_earlier < _LATE * error
    if error < _MOST_ERROR * max(rms_error(predicted), rms_error(measured)) and not is_late:
        return ""
    measured_error = rms_error(measured)
    text = f"estimated positions are off by {error:.3g} m, measured ones by {measured_error:.3g} m"
    # The errors are large: `is_far` gives advice even if no pattern explains them.
    return text + guess_cause_of_errors(estimates, data.truth, is_far=True)


def check_tracks(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that estimates follow a fast target in the plane, on one of the contract's problems."""
    # PLANAR has a position sensor, PRECISE a radar. A filter for one of these sensors may run on the
    # other one, too, and go wrong there: one problem is enough.
    mistakes = []
    for problem in (PLANAR, PRECISE):
        if runs_on(tracker, problem):
            mistakes.append(mistaken_track(tracker, problem))
    if not mistakes:
        raise LeftOutError("the filter does not run on the contract's problems")
    if all(mistakes):
        raise ContractError(mistakes[0])


_LATE = 0.3  # times the error: an estimate with a smaller error from the step before is late
_MOST_ERROR = 1.5  # times the larger one of two simple estimates' errors: a correct filter has less
