"""Likely cause of a filter's wrong estimates, in words."""

import numpy as np

from trackbench.contract.estimates import Estimates
from trackbench.core.arrays import Array

_LOST = 1.9  # RMSE above the reference's 1, at which most squared errors are beyond the cap
FIRST_FITTED = 3  # index of the first step whose errors count; those before depend on the prior
PLACE_IGNORED = (
    "the filter ignores the place of the sensor, which does not stand at the origin: it must subtract "
    "`at` from the position"
)
"""Cause of errors of a filter that is right for sensors at the origin."""
SIGMA_FOR_VARIANCE = (
    "the filter takes sigma for sigma^2, as it fits noise of the variance sigma; is R sigma^2?"
)
"""Cause of errors of a filter that is right for noise of the variance sigma."""

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
    cause = guess_cause_of_errors(estimates, path, is_far=differences.get("error", 0.0) > _LOST)
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


def guess_cause_of_errors(estimates: Estimates, path: Array, is_far: bool) -> str:
    """Guess why estimated states miss ``path`` (n, T + 1, M), as a text; empty if no cause is found.

    ``is_far`` is true if most of them are so far away that the runs are lost. The text is then a list of
    common mistakes, unless the estimates are late or have x and y exchanged.
    """
    mean = estimates.mean[: len(path)]

    def mean_square_from(other_path: Array) -> float:
        """Return the median over the runs of the mean squared difference from a path."""
        # After the first steps, which depend on the prior. The median over the runs: a lost run does not
        # count.
        squared = np.square(mean - other_path)[:, FIRST_FITTED:]
        return float(np.median(squared.mean(axis=(0, 1))))

    if mean_square_from(np.roll(path, 1, axis=1)) < 0.1 * mean_square_from(path):
        return "; estimates fit the truth one step earlier: returned before the update?"
    # A state of four components is (x, vx, y, vy).
    if len(path) == 4 and mean_square_from(path[[2, 3, 0, 1]]) < 0.1 * mean_square_from(path):
        return "; estimates fit the truth with x and y exchanged"
    if is_far:
        return "; an axis, a unit (degrees), a sign, dt or a gap is taken wrongly?"
    return ""
