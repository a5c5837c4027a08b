"""Rules of significance of differences between filters; `verdict_rules` has those on papers.

Two filters differ significantly if the studentized test of their difference on common runs rejects at
`LEVEL`, after Holm's correction over all comparisons shown (`holm_correction`). At least `FEWEST_RUNS`
runs are needed. docs/statistics.md has error rates and power.
"""

from math import log

from trackbench.core.arrays import Array
from trackbench.statistics.correlated_series import LEAST_STEPS
from trackbench.statistics.estimate_of_recording import OfSteps
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.sample_statistics import Estimate, z_score
from trackbench.statistics.sign_test import sign_test
from trackbench.statistics.student_t import deviations, normal_of_t, two_sided

LEVEL = 0.01
"""Probability that any of the filters of a family without a difference are called different."""
FEWEST_RUNS = 5
"""Runs from which on a difference of filters is tested."""
LOSSES_LEVEL = 0.05
"""Probability that chance alone makes any filter of an experiment lose more runs than another."""
TINY = 0.01
"""Share of a number below which a significant difference is called tiny, unless the config has one."""
NEAR_BEST = 2.0
"""Ratio to the best up to which an error without a significant difference shares the mark."""
NATS_NEAR_BEST = log(NEAR_BEST)
"""Nats below the best up to which a log score shares it: the predicted density is half as large."""
NOT_CHANCE = 4.0
"""Standard errors from which a number that should be zero, one of some dozens, is not."""
EQUAL = "equal"
BETTER = "better"
WORSE = "worse"
ALIKE = "no significant difference"
UNTESTED = "untested"
NEAR = 0.1
"""Share of a published number within which the difference must lie to be none."""
HOW_FILTERS_DIFFER = (
    f"at {100 * LEVEL:g} % over all pairs of filters (Holm), by the paired differences on common runs; "
    f"at least {FEWEST_RUNS} runs"
)
HOW_STEPS_DIFFER = (
    f"at {100 * LEVEL:g} % over all pairs of filters (Holm), by the steps of one recording: by an error "
    f"of their mean difference that allows for autocorrelation; at least {LEAST_STEPS} steps"
)
"""How filters differ if each point of the grid is one recorded run."""


def is_tested(difference: RunEstimate) -> bool:
    """Test whether a difference of filters has enough runs for a test, or is of a recording's steps."""
    return isinstance(difference, OfSteps) or difference.runs >= FEWEST_RUNS


def is_significant(z: float) -> bool:
    """Test whether a difference that is the only one of its family is significant."""
    return two_sided(z) < LEVEL


def interval_contradicts(sign: int, z: float) -> bool:
    """Test whether a pair's own 95 % interval shows a difference that is not significant.

    The interval, by ``z``, is of this pair alone. The ``sign`` is that of a difference that is
    significant in the whole family, at `LEVEL`, and 0 of any other difference.
    """
    return sign == 0 and abs(z) > deviations(0.95)


def loses_more(a: Array, b: Array, filters: int) -> bool:
    """Test whether the first filter loses significantly more of the same runs than the second.

    ``a`` and ``b`` (M,) are codes of both filters, above zero where a run is lost. It is a sign test of
    the runs that only one of the two loses, with Bonferroni's correction for all pairs of ``filters``.
    """
    pairs = 0.5 * filters * (filters - 1)
    z = sign_test(a > 0, b > 0)
    return z > 0.0 and two_sided(z) * pairs < LOSSES_LEVEL


def is_no_chance(number: Estimate, runs: int) -> bool:
    """Test whether a number that should be zero is not, by Student's t of so many runs."""
    return abs(normal_of_t(z_score(number), max(runs - 1.0, 1.0))) > NOT_CHANCE


def share_that_matters(share: float | str | None) -> float:
    """Return the share of a number from which a difference matters.

    Parameters
    ----------
    share
        share in the config, as 0.05 or 5%; None means the default `TINY`

    Returns
    -------
    float
        share, such as 0.05
    """
    if share is None:
        return TINY
    if isinstance(share, str):
        return float(share.removesuffix("%")) / 100.0
    return share
