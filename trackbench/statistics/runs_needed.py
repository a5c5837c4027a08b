"""Number of runs that an inconclusive difference would need, and its text."""

from trackbench.statistics.significance_rules import LEVEL
from trackbench.statistics.student_t import deviations

_MOST_RUNS = 1e6
"""Estimated number of runs from which on it is not written as a number."""


def deviations_needed(tests: int) -> float:
    """Return the z from which the largest one of so many differences is significant."""
    return deviations(1.0 - LEVEL / tests)  # Holm's first step is Bonferroni's


def runs_that_decide(runs: int, z: float, needed: float) -> float:
    """Extrapolate how many runs raise the z of a difference to a needed one.

    Parameters
    ----------
    runs
        number of runs with which ``z`` was measured. If it is 1, the run is a recording
    z
        z of the difference, in standard errors, which is not zero
    needed
        z that decides, in standard errors

    Returns
    -------
    float
        number of runs, at least one more than ``runs``; of a recording a multiple of its length
    """
    # To first order z grows with the root of the runs.
    runs_needed = runs * (needed / z) ** 2
    # The runs did not decide; rounding may not say that fewer would.
    if runs > 1:
        return max(runs_needed, runs + 1.0)
    return runs_needed


def run_count(runs: float) -> str:
    """Write an estimated number of runs with two digits: ``5800``, ``more than 1000000``."""
    if runs < _MOST_RUNS:
        return f"{float(f'{runs:.2g}'):.0f}"
    return f"more than {_MOST_RUNS:.0f}"
