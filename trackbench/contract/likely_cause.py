"""Likely cause of a filter's wrong estimates, in words; checks of estimates against a fast track."""

from typing import cast

import numpy as np

from trackbench.contract.estimates import Estimates, run_filter, simulate
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.models.base import LocatingSensor
from trackbench.scenarios.tracking import Tracking

_LOST = 1.9  # RMSE above the reference's 1, at which most squared errors are beyond the cap
_FIRST_FITTED = 3  # index of the first step whose errors count; those before depend on the prior
_LATE = 0.3  # times the error: an estimate with a smaller error from the step before is late
_MOST_ERROR = 1.5  # times the larger one of two simple estimates' errors: a correct filter has less
PLACE_IGNORED = (
    "the filter ignores the place of the sensor, which does not stand at the origin: it must subtract "
    "`at` from the position"
)
"""Cause of errors of a filter that is right for sensors at the origin."""

_OTHER_METHOD = (
    "no usual mistake explains it: a method that differs on purpose, such as R at the measured "
    "position, may be beyond the limit (docs/extending.md#the-contract)"
)
"""Text in place of a cause, if none is found."""


def guess_cause(estimates: Estimates, path: Array, differences: dict[str, float]) -> str:
    """Guess why estimates differ from a reference or from the truth, as a text after the differences.

    ``path`` (n, T + 1, M) are the states of the reference or of the truth. ``differences`` are those of
    the scores that are wrong, by their names (fields of `Scores`): the filter's mean score minus a
    reference's. If "squared_distance" is among them, so is "error", the difference of the RMSE in
    standard deviations. If the estimates are far from the reference, and neither their pattern nor the
    covariance gives a cause, the filter may be right by another method.
    """
    cause = _guess_cause_of_errors(estimates, path, is_far=differences.get("error", 0.0) > _LOST)
    if cause:
        return cause
    # A covariance that is too large makes the ANEES too small.
    excess_of_covariance = differences.get("spread", -differences.get("anees", 0.0))
    if excess_of_covariance > 0.0:
        return "; the covariance is too large: does the update reduce it by the gain, is R sigma^2?"
    if excess_of_covariance < 0.0:
        return "; the covariance is too small: sigma for sigma^2, or a noise or dt forgotten?"
    if "squared_distance" in differences:
        return f"; {_OTHER_METHOD}"
    # Estimates and covariances fit: only ANIS or log-likelihood is wrong.
    return "; are the innovation and S those before the update?"


def _guess_cause_of_errors(estimates: Estimates, path: Array, is_far: bool) -> str:
    """Guess why estimated states miss ``path`` (n, T + 1, M), as a text; empty if no cause is found.

    ``is_far`` is true if most of them are so far away that the runs are lost. The text is then a list of
    common mistakes, unless the estimates are late or have x and y exchanged.
    """
    mean = estimates.mean[: len(path)]

    def mean_square_from(other_path: Array) -> float:
        """Return the median over the runs of the mean squared difference from a path."""
        # After the first steps, which depend on the prior. The median over the runs: a lost run does not
        # count.
        squared = np.square(mean - other_path)[:, _FIRST_FITTED:]
        return float(np.median(squared.mean(axis=(0, 1))))

    if mean_square_from(np.roll(path, 1, axis=1)) < 0.1 * mean_square_from(path):
        return "; estimates fit the truth one step earlier: returned before the update?"
    # A state of four components is (x, vx, y, vy).
    if len(path) == 4 and mean_square_from(path[[2, 3, 0, 1]]) < 0.1 * mean_square_from(path):
        return "; estimates fit the truth with x and y exchanged"
    if is_far:
        return "; an axis, a unit (degrees), a sign, dt or a gap is taken wrongly?"
    return ""


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
        squared = np.square(position - true_position)[:, _FIRST_FITTED:]
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
    return text + _guess_cause_of_errors(estimates, data.truth, is_far=True)
