"""Ratios of two numbers, such as errors of two filters: their standard errors and intervals."""

from collections.abc import Callable

import numpy as np

from trackbench.statistics.estimate_of_recording import OfSteps
from trackbench.statistics.estimates import RunEstimate, ignore_float_errors, linear_combination
from trackbench.statistics.jackknife import influence_of_ratio
from trackbench.statistics.sample_statistics import mean
from trackbench.statistics.student_t import deviations


@ignore_float_errors
def quotient(a: RunEstimate, b: RunEstimate) -> RunEstimate:
    """Return ``a / b`` with its standard error, paired by the runs or steps that both have.

    The error is by the jackknife over the runs. It is by the delta method for steps, and for numbers
    whose influences are missing or are those of other runs.

    Parameters
    ----------
    a, b
        numbers of the same runs, or of the steps of one recording

    Returns
    -------
    RunEstimate
        ratio, with influences where both numbers have them
    """
    ratio = float(np.divide(a.value, b.value))
    if isinstance(a, OfSteps) and isinstance(b, OfSteps):
        # Each step's influence on the ratio is (a_t - ratio b_t) / b.
        a_less_ratio_b = a.minus(b, ratio)
        return a_less_ratio_b.over(ratio, b.value)
    # d(a / b) = da / b - (a / b) db / b
    scale = float(np.divide(1.0, b.value))
    term = linear_combination(ratio, a, b, scale, -scale * ratio)
    # Without influences of the same runs on both numbers the delta method has to do.
    if a.influences is None or b.influences is None or not term.has_influences:
        return term
    influences = influence_of_ratio(a.value, b.value, a.influences, b.influences)
    stderr = mean(influences[~np.isnan(influences)]).stderr
    return term._replace(influences=influences, stderr=stderr)


_FARTHEST_RATIO = 1e4
"""Multiple of a ratio beyond which its limit counts as infinite."""
_RATIO_STEP = 0.01
"""First step from a ratio, as a share of it, in the search of its limits."""
_RATIO_ROUNDING = 1e-6
"""Share of a ratio to which its limits are found."""


@ignore_float_errors
def ratio_interval(a: RunEstimate, b: RunEstimate, level: float = 0.95) -> tuple[float, float]:
    """Return the confidence interval of ``a / b`` of two numbers that cannot be negative.

    The interval contains every ratio r for which the test of ``a - r b = 0`` does not reject (Fieller
    1954, J. R. Statist. Soc. B 16, 175). It excludes 1 exactly if the difference of a and b is
    significant at that level. The interval of one recording is computed for the logarithm of the ratio,
    since the few independent pieces of a recording do not show that a mean of positive numbers is
    positive.

    Parameters
    ----------
    a, b
        numbers of the same runs, or of the steps of one recording
    level
        probability that the interval covers

    Returns
    -------
    low, high : float
        ends of the interval. The upper end is infinite if b may be zero. Both are NaN without a standard
        error
    """
    ratio = float(np.divide(a.value, b.value))
    if not 0.0 < ratio < np.inf or not b.value > 0.0:
        return np.nan, np.nan
    if isinstance(a, OfSteps) and isinstance(b, OfSteps):
        return _ratio_interval_of_steps(a, b, level)
    limit = deviations(level)

    def excludes(r: float) -> bool:
        return abs(_less_multiple(a, b, r).z()) >= limit

    # The ratio itself has z = 0 with any error; that of one nearby is NaN without a standard error.
    if np.isnan(_less_multiple(a, b, (1.0 + _RATIO_STEP) * ratio).z()):
        return np.nan, np.nan
    # Doubled steps look for a ratio that is excluded, down to zero and up to the farthest.
    low = _limit_of_ratio(excludes, ratio, -_RATIO_STEP * ratio, 0.0)
    high = _limit_of_ratio(excludes, ratio, _RATIO_STEP * ratio, _FARTHEST_RATIO * ratio)
    if high >= _FARTHEST_RATIO * ratio:
        high = np.inf
    return low, high


def _ratio_interval_of_steps(a: OfSteps, b: OfSteps, level: float) -> tuple[float, float]:
    """Return the interval of ``a / b`` of one recording, by the logarithm of the ratio."""
    assert a.influences is not None
    assert b.influences is not None
    # log(a / b) changes by (a_t - a) / a - (b_t - b) / b per step, to first order.
    log_ratio = float(np.log(a.value / b.value))
    steps = a.influences / a.value - b.influences / b.value
    # A step's contribution is the number plus the step's influence.
    low, high = OfSteps.from_contributions(log_ratio, steps + log_ratio).interval(level)
    return float(np.exp(low)), float(np.exp(high))


def _less_multiple(a: RunEstimate, b: RunEstimate, r: float) -> RunEstimate:
    """Return ``a - r b``, paired by runs."""
    return linear_combination(a.value - r * b.value, a, b, 1.0, -r)


def _limit_of_ratio(
    excludes: Callable[[float], bool], ratio: float, step: float, farthest: float
) -> float:
    """Return the ratio at which a test begins to exclude ratios on one side of ``ratio``.

    The sign of the first ``step`` is that of the side. The result is ``farthest`` if the test excludes
    no ratio up to that one.
    """
    # Step 1: double the step until the test excludes.
    inside = ratio
    outside = ratio + step
    while not excludes(outside):
        step *= 2.0
        inside = outside
        outside = ratio + step
        if abs(step) >= abs(farthest - ratio):
            if not excludes(farthest):
                return farthest
            outside = farthest
    # Step 2: bisect between the last two ratios.
    while abs(outside - inside) > _RATIO_ROUNDING * ratio:
        middle = 0.5 * (inside + outside)
        if excludes(middle):
            outside = middle
        else:
            inside = middle
    return outside


@ignore_float_errors
def gain(ratio: RunEstimate) -> RunEstimate:
    """Return by how many percent the ratio is below one."""
    return ratio.scaled(100.0 * (1.0 - ratio.value), factor=-100.0)
